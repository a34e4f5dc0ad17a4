// Arrays of numpy at the boundary of the module: their shapes are checked before anything reads them, types by nanobind.
#pragma once
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <initializer_list>
#include <stdexcept>
#include <string>
#include <vector>

namespace nb = nanobind;
using namespace nb::literals;

namespace vig {

template <class T> using Input = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;
template <class T> using InOut = nb::ndarray<T, nb::c_contig, nb::device::cpu>;
template <class T> using Output = nb::ndarray<nb::numpy, T>;

inline std::string text(const std::vector<int64_t>& shape) {
    std::string out = "(";
    for (const int64_t size : shape)
        out += (size < 0 ? "any" : std::to_string(size)) + ", ";
    return out.substr(0, out.size() - (shape.empty() ? 0 : 2)) + ")";
}

// Throw unless an array has a shape, -1 standing for any size.
template <class A> void check_shape(const char* name, const A& array, std::vector<int64_t> wanted) {
    std::vector<int64_t> shape;
    bool fits = array.ndim() == wanted.size();
    for (size_t i = 0; i < array.ndim(); ++i) {
        shape.push_back(array.shape(i));
        fits = fits && (wanted[i] < 0 || wanted[i] == shape.back());
    }
    if (!fits)
        throw std::invalid_argument(std::string(name) + " must be " + text(wanted) + "; got " + text(shape));
}

// How messages name the types of numbers.
template <class T> const char* type_name() {
    if constexpr (std::is_same_v<T, bool>)
        return "bool";
    else if constexpr (std::is_floating_point_v<T>)
        return sizeof(T) == 4 ? "float32" : "float64";
    else if constexpr (std::is_unsigned_v<T>)
        return sizeof(T) == 1 ? "uint8" : "uint32";
    else
        return sizeof(T) == 2 ? "int16" : sizeof(T) == 4 ? "int32" : "int64";
}

// An argument that must be an array of exactly this type, in C order, of a shape, -1 standing for any size.
template <class T> Input<T> array_of(const char* name, nb::handle given, std::vector<int64_t> shape) {
    Input<T> array;
    bool fits = nb::try_cast(given, array, false) && array.ndim() == shape.size();
    for (size_t i = 0; fits && i < shape.size(); ++i)
        fits = shape[i] < 0 || shape[i] == (int64_t)array.shape(i);
    if (fits)
        return array;
    const auto said = [](nb::handle value) { return std::string(nb::str(value).c_str()); };
    const bool is_array = nb::hasattr(given, "dtype") && nb::hasattr(given, "shape") && nb::hasattr(given, "flags");
    const std::string came = !is_array ? said(given.type())
        : said(nb::object(given.attr("shape"))) + " of " + said(nb::object(given.attr("dtype")))
            + (nb::object(given.attr("flags").attr("c_contiguous")).is(Py_True) ? "" : " in another order");
    throw std::invalid_argument(std::string(name) + " must be " + text(shape) + " of " + type_name<T>() + " in C order; got "
                                + came);
}

template <class R> using Optional = std::optional<Input<R>>;
template <class R> using OptionalOut = std::optional<InOut<R>>;
template <class A> auto data_or_null(const std::optional<A>& array) { return array ? array->data() : nullptr; }

template <class A> auto copy(const A& array) {
    return std::vector<std::remove_const_t<typename A::Scalar>>(array.data(), array.data() + array.size());
}

// Throw unless all numbers of a table are from `least` to `count` - 1.
inline void check_table(const char* name, const int32_t* table, size_t size, int least, int64_t count) {
    if (size == 0)
        return;
    const auto [low, high] = std::minmax_element(table, table + size);
    if (*low < least || *high >= count)
        throw std::invalid_argument(std::string(name) + " must be from " + std::to_string(least) + " to " +
                                    std::to_string(count - 1) + "; they are from " + std::to_string(*low) + " to " +
                                    std::to_string(*high));
}
inline void check_table(const char* name, const std::vector<int32_t>& table, int least, int64_t count) {
    check_table(name, table.data(), table.size(), least, count);
}

template <class T> Output<T> make(std::initializer_list<size_t> shape) {
    size_t size = 1;
    for (const size_t length : shape)
        size *= length;
    T* const data = new T[std::max<size_t>(size, 1)];
    nb::capsule owner(data, [](void* p) noexcept { delete[] (T*)p; });
    return Output<T>(data, shape, owner);
}
template <class T> Output<T> make_copy(const std::vector<T>& numbers, std::initializer_list<size_t> shape) {
    const Output<T> array = make<T>(shape);
    std::copy_n(numbers.data(), array.size(), array.data());
    return array;
}

void bind_scenes(nb::module_& m);

}  // namespace vig
