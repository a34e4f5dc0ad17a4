"""Warp, set up once: quiet, forward kernels only, any scalar type; native code, and calls of kernels."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, cast

import torch
import warp as wp

from vig_renderer.checks import check_indices
from vig_renderer.errors import UserError
from vig_renderer.internals import packed_launch
from vig_renderer.once import MAKING, make_once

TEMPLATES = Path(__file__).with_name("templates")
"""Folder of the renderer's kernels; see `instantiate`."""


class _Opaque(torch.autograd.Function):
    @staticmethod
    def forward(run: Callable[..., Any], *arguments: Any) -> Any:
        return run(*arguments)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        pass

    @staticmethod
    def vmap(info: Any, axes: tuple[Any, ...], run: Callable[..., Any], *arguments: Any) -> Any:
        if any(axis is not None for axis in axes[1:]):
            raise NotImplementedError("the renderer draws no scenes under vmap; give `render` a list of them")
        return run(*arguments), None

    @staticmethod
    def backward(ctx: Any, *cotangents: Any) -> Any:
        raise NotImplementedError("the renderer has first derivatives only; a second one was asked for")

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> Any:
        raise NotImplementedError("the renderer has first derivatives only; a second one was asked for")


def opaque(run: Callable[..., Any], *arguments: Any) -> Any:
    """Call `run` on plain, contiguous tensors, also where a transform of torch.func has wrapped them.

    run launches kernels: torch sees nothing of what it does. A derivative through it is refused, so that
    a second derivative of the renderer is an error and not silently zero.
    """
    initialise()
    apply: Callable[..., Any] = _Opaque.apply
    return apply(run, *(a.contiguous() if isinstance(a, torch.Tensor) else a for a in arguments))


def launch(kernel: wp.Kernel, count: int | tuple[int, ...], *arguments: Any) -> None:
    """Run a kernel on `count` threads of its tensors' device.

    Args:
        kernel: Its array arguments are annotated `wp.array(dtype=...)`.
        count: Threads along each axis.
        arguments: In the kernel's order; a contiguous tensor becomes an array of the annotated type, no copy.
    """
    device = next(argument.device for argument in arguments if isinstance(argument, torch.Tensor))
    kept, key = _here.__dict__.setdefault("launches", {}), (kernel, count, *map(_kind, arguments))
    if device.type == "cpu" and (prepared := kept.get(key)) is not None:
        # Describing arguments takes longer than many kernels run: a launch like one before is that one again.
        prepared.repeat(arguments)
        return
    inputs = _described(kernel, arguments)
    # Recording takes longer than describing: what comes once, as lengths that depend on data do, is launched.
    if device.type != "cpu" or key not in kept:
        start(kernel, count, inputs, device)
        command = None
    else:
        command = record(kernel, count, inputs)
    prepared = None if command is None else Prepared(command)
    if prepared is not None:
        prepared()
        prepared = prepared if prepared.packed is not None else None
    if len(kept) >= KEPT_LAUNCHES:
        kept.clear()
    kept[key] = prepared


def record(
    kernel: wp.Kernel,
    count: int | tuple[int, ...],
    inputs: Sequence[Any],
    device: torch.device | str = "cpu",
) -> Any:
    """A launch, not yet run, of a kernel that is compiled and loaded now; None of a count of 0."""
    with MAKING:
        return wp.launch(kernel, count, inputs, device=str(device), record_cmd=True)


def start(
    kernel: wp.Kernel,
    count: int | tuple[int, ...],
    inputs: Sequence[Any],
    device: torch.device | str = "cpu",
) -> None:
    """Launch a kernel once."""
    if (command := record(kernel, count, inputs, device)) is not None:
        command.launch(current_stream(device))


def _described(kernel: wp.Kernel, arguments: Sequence[Any]) -> list[Any]:
    """Arguments of a launch; tensors as bare descriptors, faster made than arrays; the caller keeps them."""
    return [
        wp.from_torch(argument, dtype=kind.dtype, requires_grad=False, return_ctype=True)
        if isinstance(argument, torch.Tensor)
        else argument
        for argument, kind in zip(arguments, kernel.func.__annotations__.values(), strict=True)
    ]


def _kind(argument: Any) -> Any:
    """What two launches must have in common for one to be the other with other pointers."""
    if isinstance(argument, torch.Tensor):
        return argument.dtype, argument.shape, argument.stride()
    return argument


KEPT_LAUNCHES = 256
"""Launches that a thread keeps, to repeat those that have come twice."""
_here = threading.local()


def current_stream(device: torch.device | str) -> wp.Stream | None:
    """torch's current stream on a GPU, so that kernels and torch's own run in turn; None on the CPU."""
    if torch.device(device).type == "cpu":
        return None
    return _warp_stream(str(device), torch.cuda.current_stream(device).cuda_stream)


@make_once
def _warp_stream(device: str, handle: int) -> wp.Stream:
    return wp.Stream(device, cuda_stream=handle)


def kernel_module(part: str, dtype: torch.dtype) -> str:
    """The name under which a file's kernels of one scalar type are cached."""
    return f"vig_{part}_{str(dtype).removeprefix('torch.')}"


def check_floats(**tensors: tuple[torch.Tensor, tuple[int | None, ...]]) -> None:
    """ValueError unless all tensors have their shapes (None: any size) and one type, float32 or float64."""
    first = next(iter(tensors.values()))[0]
    for name, (tensor, shape) in tensors.items():
        _check_shape(name, tensor, shape)
        if tensor.dtype not in (torch.float32, torch.float64) or tensor.dtype != first.dtype:
            raise ValueError(f"{name} must be float32 or float64, all of one type; got {tensor.dtype}")
        if tensor.device != first.device:
            raise ValueError(f"{name} must be on {first.device} like the others; got {tensor.device}")


def check_table(
    name: str, table: torch.Tensor, shape: tuple[int | None, ...], count: int | None = None, least: int = 0
) -> None:
    """ValueError unless a table is int32, of a shape (None: any size), and names rows least to count - 1.

    count: None leaves the rows unchecked, where they come from a table that was checked.
    """
    _check_shape(name, table, shape)
    if table.dtype != torch.int32:
        raise ValueError(f"{name} must be int32; got {table.dtype}")
    if count is not None:
        check_indices(name, table, count, least)


def table_state(*tables: torch.Tensor) -> tuple[object, ...]:
    """What changes where tables are written to or exchanged.

    Not where memory that a table shares with numpy, or an inference tensor, is written to.
    """
    try:
        places = [each.data_ptr() for each in tables]
    except RuntimeError:  # a transform of torch.func has wrapped one
        places = []
    return (*places, *[(0 if each.is_inference() else each._version, each.nbytes) for each in tables])


def check_size(size: tuple[int, int, int]) -> None:
    """ValueError unless a size is of images, rows and columns, one or more of each."""
    if len(size) != 3 or min(size) < 1:
        raise ValueError(f"size must be images, rows and columns, at least one of each; got {tuple(size)}")


def _check_shape(name: str, tensor: torch.Tensor, shape: tuple[int | None, ...]) -> None:
    fits = tensor.ndim == len(shape) and all(
        want in (None, have) for want, have in zip(shape, tensor.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if size is None else str(size) for size in shape)
        raise ValueError(f"{name} must be ({wanted}); got {tuple(tensor.shape)}")


wp.config.log_level = wp.LOG_ERROR
wp.config.enable_backward = False
wp.config.use_precompiled_headers = False  # making them takes longer than one module does
if hasattr(wp.config, "cpu_compiler_flags"):  # of Warp's own products and sums, too, which are functions
    wp.config.cpu_compiler_flags = f"{wp.config.cpu_compiler_flags or '-march=native'} -ffp-contract=fast"

_NATIVE = {wp.float32: "float", wp.float64: "double"}


@make_once
def initialise() -> None:
    """Start Warp. UserError when its library cannot be loaded or its kernel cache not be written."""
    try:
        with _without_native_messages():
            wp.init()
    except (OSError, RuntimeError) as error:
        raise UserError(f"Warp could not start: {error}; `vig doctor` reports more") from error


@contextmanager
def _without_native_messages() -> Iterator[None]:
    """Keep Warp's library from writing to the terminal of a missing CUDA driver, whatever the log level."""
    sys.stderr.flush()
    terminal, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(terminal, 2)
        os.close(terminal)
        os.close(nowhere)


def scalar_type(dtype: torch.dtype) -> type:
    """Warp's scalar for torch.float32 or torch.float64."""
    if dtype not in (torch.float32, torch.float64):
        raise ValueError(f"the renderer works in float32 or float64; got {dtype}")
    return wp.float32 if dtype == torch.float32 else wp.float64


def vector_types(dtype: torch.dtype) -> dict[str, Any]:
    """Warp's types of one scalar by the names that templates use: real, vec2, vec3, vec4, mat33."""
    initialise()
    real = scalar_type(dtype)
    vectors = {f"vec{length}": wp.types.vector(length, real) for length in (2, 3, 4)}
    return {"real": real, "mat33": wp.types.matrix((3, 3), real), **vectors}


def instantiate(templates: Iterable[Path], name: str, **names: Any) -> Any:
    """Execute files of kernels, one after the other, in one new module in which `names` are defined.

    A template is Python whose functions and structs Warp compiles. It is executed once for each scalar type
    or size, which it names `real` or the like; an import would give it one meaning for all.

    Args:
        templates: Paths; a file sees what those before it define.
        name: Of the module, and `module` in the files: that of Warp in which the kernels are cached.
        names: What the files may name beside it.
    """
    made = ModuleType(name)
    sys.modules[name] = made  # where Warp looks for the source of a function
    vars(made).update(names, module=name)
    for path in templates:
        exec(compile(path.read_text(encoding="utf-8"), path, "exec", dont_inherit=True), vars(made))
    return made


def native_code(folder: Path, *files: str, real: type, **constants: int | float) -> str:
    """The code of .cc files, one after the other, for `wp.func_native`: bodies of functions.

    Before it stand the type `real` and the constants as `constexpr`, each of its Python type.
    """
    preamble = [f"typedef {_NATIVE[real]} real;"]
    for name, number in constants.items():
        if isinstance(number, float):
            preamble.append(f"constexpr real {name} = real({number!r});")
        else:
            kind = "bool" if isinstance(number, bool) else "wp::int64" if number.bit_length() > 31 else "int"
            preamble.append(f"constexpr {kind} {name} = {str(number).lower()};")
    return "\n".join([*preamble, *((folder / file).read_text() for file in files)])


def warp_array(tensor: torch.Tensor, dtype: type) -> wp.array[Any]:
    """A Warp view of a contiguous tensor, no copy; trailing axes become the vector type's."""
    initialise()
    return cast("wp.array[Any]", wp.from_torch(tensor, dtype=dtype, requires_grad=False))


class Prepared:
    """A recorded launch as a call of little overhead, whose tensors can be exchanged.

    The launch is kept; what its arguments point to, the caller keeps.
    """

    def __init__(self, command: wp.Launch):
        device = str(command.device)
        self._launch: Callable[[], object] = lambda: command.launch(current_stream(device))
        self.packed: Any = None
        if (packed := packed_launch(command)) is not None:
            self._launch, self.packed = packed

    def __call__(self) -> object:
        """Launch."""
        return self._launch()

    def repeat(self, arguments: Sequence[Any]) -> None:
        """Launch with other tensors of the same kinds in the place of those that it was recorded with."""
        self.take(arguments)
        self._launch()

    def take(self, arguments: Sequence[Any]) -> None:
        """From now on the tensors are these, of the same kinds; only where the arguments are packed."""
        for index, argument in enumerate(arguments):
            if isinstance(argument, torch.Tensor):
                getattr(self.packed, f"argument_{index}").data = argument.data_ptr()
