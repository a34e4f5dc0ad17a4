"""A trained recognition network: numpy arrays in, predictions out, computed by ONNX Runtime."""

import copy
import functools
import hashlib
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self
from weakref import WeakValueDictionary

import numpy as np
import onnxruntime

from vig.io.checks import decode, parse_json, read_tensors, reading
from vig.io.errors import UserError
from vig.parallel.threads import map_on_threads, on_one_core
from vig.recognition.graph import INPUT, map_model, weight_shapes, window_model, window_outputs
from vig.recognition.network import LOG_VARIANCE, Heads, NetworkCalibration, NetworkSettings, mask_at_pixels
from vig.recognition.object_map import NUMBERS
from vig.recognition.prediction import Prediction
from vig.recognition.weights import FORMAT, network_weights, whole_tensors
from vig.scene import ObjectClass, Symmetry, regressed_layout, srgb_from_linear
from vig.scene.functions import numpy_of_tensor, sigmoid, softmax

BOTH_SIDES = False, True
"""A photo and its mirror image."""
WEIGHTS_FILE = "recognition.safetensors"
"""The file's name in a class pack or a training run."""
AT_ONCE = 8
"""Images that pass the network in one call; more need more memory and no less time."""
_sessions: WeakValueDictionary[bytes, onnxruntime.InferenceSession] = WeakValueDictionary()
_creating = threading.Lock()


def _session(model: bytes) -> onnxruntime.InferenceSession:
    """Return a session of a model on one thread; the same for the same model, while somebody holds it."""
    digest = hashlib.sha256(model).digest()
    with _creating:
        if (session := _sessions.get(digest)) is None:
            options = onnxruntime.SessionOptions()
            options.intra_op_num_threads = options.inter_op_num_threads = 1
            options.log_severity_level = 4  # failures are raised
            options.enable_cpu_mem_arena = False  # frees unneeded memory, as fast
            # It is as fast for windows, at once in half the time, and the weights are held but once.
            options.add_session_config_entry("session.disable_prepacking", "1")
            session = onnxruntime.InferenceSession(model, options, ["CPUExecutionProvider"])
            _sessions[digest] = session
        return session


class Recognizer:
    """A trained recognition network, from `recognition.safetensors` of a class pack or a training run."""

    informed = True
    """Whether its predictions depend on the photo."""

    @property
    def has_map(self) -> bool:
        """Return whether the network finds objects in whole photos."""
        return bool(self.settings.object_map)

    kind = "vig"
    """Which networks this reads, as a weights file's metadata names them."""
    settings: Any
    weights: dict[str, np.ndarray]
    """Weights of the network, by name, float32."""
    mean: np.ndarray
    """(M,) of the regressed numbers, in whose `deviation` they are predicted."""
    deviation: np.ndarray
    _latest: tuple[np.ndarray, Any, NetworkCalibration, Prediction] | None = None
    """The last photo that was asked for alone, how, by which calibration, and the answer."""
    symmetry, mirror = Symmetry.NONE, True
    """Symmetry of the class; without mirror symmetry photos are not flipped."""

    def __init__(self, path: Path):
        pack = path.parent
        verb = f"vig class train {pack}" if (pack / "class.json").exists() else "vig train"
        remedy = f"Train them with `{verb}` or take a class that has them."
        with reading(path, "recognition weights", remedy):
            tensors, metadata = read_tensors(path)
            settings = decode(dict[str, Any], parse_json(metadata["settings"]))
            if (kind := metadata.get("net", "vig")) != self.kind:
                raise ValueError(f"it is of a network of kind '{kind[:40]}', where '{self.kind}' is read")
            if (version := metadata.get("format", "1")) != FORMAT:
                raise ValueError(f"it is of format {version[:40]}, where this vig reads {FORMAT}")
            tensors = whole_tensors(tensors, metadata)
            self._read(path, settings, tensors)
            numbers = regressed_layout(self.settings.modes).size
            self.calibration = NetworkCalibration.of(tensors, numbers)

    def _read(self, path: Path, settings: dict[str, Any], tensors: dict[str, np.ndarray]) -> None:
        """Set the network and its targets' scale."""
        self.settings = decode(NetworkSettings, settings)
        self.weights = network_weights(tensors)
        self.mean, self.deviation = tensors["scale.mean"], tensors["scale.deviation"]
        for scale in (self.mean, self.deviation):
            if scale.shape != (regressed_layout(self.settings.modes).size,) or scale.dtype != np.float32:
                raise ValueError("the scale does not fit the network")
        if not (self.deviation > 0).all():
            raise ValueError("a standard deviation of the scale is not positive")
        shapes = weight_shapes(self.settings)
        if odd := sorted(shapes.keys() ^ self.weights.keys()):
            raise ValueError(f"weights are missing or unknown: {', '.join(odd)[:100]}")
        for name, shape in shapes.items():
            if self.weights[name].shape != shape:
                raise ValueError(f"'{name}' must be {shape}; it is {self.weights[name].shape}")
        self._session_of("window")

    @functools.cached_property
    def _held(self) -> dict[str, onnxruntime.InferenceSession]:
        """Return the sessions of the models used so far: `window`, of the whole photo `map`."""
        return {}

    def _session_of(self, which: str) -> onnxruntime.InferenceSession:
        if which not in self._held:
            model = window_model if which == "window" else map_model
            self._held[which] = _session(model(self.settings, self.weights))
        return self._held[which]

    def __getstate__(self) -> dict[str, Any]:
        """Leave out sessions, which another process makes anew."""
        return {name: value for name, value in vars(self).items() if name not in ("_held", "_latest")}

    def with_weights(self, changed: Mapping[str, np.ndarray]) -> Self:
        """Return the recognizer with some weights replaced, by name, by others of the same shapes."""
        other = copy.copy(self)
        other.weights = {**self.weights, **changed}
        other._session_of("window")
        return other

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all numbers that its predictions depend on."""
        return {**self.weights, "mean": self.mean, "deviation": self.deviation, **self.calibration.tensors()}

    @classmethod
    def of_class(cls, object_class: ObjectClass, weights: Path | None = None) -> Self:
        """Return the class's own recognizer, or one from other `weights`; UserError for another class's."""
        path = weights or (object_class.folder or Path()) / WEIGHTS_FILE
        recognizer = cls(path)
        network_modes, modes = recognizer.settings.modes, object_class.shape_model.modes
        if network_modes != modes:
            raise UserError(
                f"expected weights for the {modes} shape components of class '{object_class.name}';"
                f" '{path}' has {network_modes}. "
                + (
                    "Train them on a dataset of that class."
                    if weights
                    else f"Run `vig class train {path.parent}`."
                )
            )
        recognizer.symmetry, recognizer.mirror = object_class.symmetry, object_class.mirror
        return recognizer

    def __call__(self, photos: Any, batch: int = 32, sides: Sequence[bool] = BOTH_SIDES) -> Prediction:
        """Predict from linear RGB photos (N, S, S, 3) in [0, 1], S = 150, as many batches at once as cores.

        Each batch is computed on one core, so that predictions do not depend on how many there are. `sides`:
        which of a photo and its mirror image (True) the network sees; the mean of both is better and takes
        twice as long. A class that is not its own mirror image is never mirrored. A single photo asked for
        twice in a row is answered from memory: windows are seen to turn them, then to fit.
        """

        def predict(part: np.ndarray) -> Prediction:
            return on_one_core(lambda: self._predict(part, sides)).fold(self.symmetry)

        photos = np.ascontiguousarray(numpy_of_tensor(photos), np.float32)
        asked = sides, self.mirror, self.symmetry
        if (before := self._latest) is not None and before[1] == asked and before[2] is self.calibration:
            if np.array_equal(before[0], photos):
                return before[3].clone()
        parts = [photos[start : start + batch] for start in range(0, max(len(photos), 1), batch)]
        predicted = Prediction.concatenate(list(map_on_threads(predict, parts)))
        kept = photos.copy(), asked, self.calibration, predicted.clone()
        self._latest = kept if len(photos) == 1 else None
        return predicted

    def heads(self, pixels: np.ndarray, sides: Sequence[bool] = BOTH_SIDES) -> Heads:
        """Return the network's outputs, before calibration, for sRGB images (N, 3, S, S); see `__call__`."""
        sides = sides if self.mirror else (False,)
        zero = -self.mean / self.deviation
        seen = [self._heads(pixels[..., ::-1] if mirrored else pixels) for mirrored in sides]
        upright = [
            heads.of_mirrored(zero) if mirrored else heads
            for heads, mirrored in zip(seen, sides, strict=True)
        ]
        return functools.reduce(Heads.mean_with, upright)

    def _heads(self, pixels: np.ndarray) -> Heads:
        """Return the outputs for images as they are, without mirror images."""
        shapes = window_outputs(self.settings)
        # Models take one image or more; no images have empty outputs.
        parts = [[np.zeros((0, *shape), np.float32) for shape in shapes.values()]]
        for start in range(0, len(pixels), AT_ONCE):
            image = np.ascontiguousarray(pixels[start : start + AT_ONCE], np.float32)
            parts.append(self._run("window", image, {name: (len(image), *shapes[name]) for name in shapes}))
        azimuth, numbers, others, mask = (np.concatenate(each) for each in zip(*parts, strict=True))
        mean, log_variance = np.split(numbers, 2, axis=1)
        return Heads(azimuth, mean, log_variance.clip(*LOG_VARIANCE), others[:, 0], others[:, 1], mask)

    def object_map(self, image: np.ndarray) -> np.ndarray:
        """Return the map of objects of an image (1, 3, H, W): `NUMBERS` of each cell (1, 5, h, w)."""
        image = np.ascontiguousarray(image, np.float32)
        height, width = image.shape[2:]
        for _ in range(4):
            height, width = -(-height // 2), -(-width // 2)
        return self._run("map", image, {"numbers": (1, NUMBERS, height, width)})[0]

    def _run(self, which: str, image: np.ndarray, shapes: Mapping[str, tuple[int, ...]]) -> list[np.ndarray]:
        """Compute outputs of these names and shapes from an image; UserError where they are not numbers."""
        try:
            found: list[np.ndarray] = self._session_of(which).run(list(shapes), {INPUT: image})
            got = [each.shape for each in found]
            if got != list(shapes.values()) or not all(np.isfinite(each).all() for each in found):
                raise ValueError(f"outputs of shapes {got}, or some that are not finite")
        except Exception as error:  # ONNX Runtime raises any type, without memory for one
            told = " ".join(str(error).split())[:200]
            if not np.isfinite(image).all():
                raise UserError(
                    "expected a photo of finite numbers; got NaN or infinity. Mend it."
                ) from error
            raise UserError(
                f"expected a recognition network that predicts; got {told}. Copy the class's pack again."
            ) from error
        return found

    def _predict(self, photos: np.ndarray, sides: Sequence[bool]) -> Prediction:
        heads = self.heads(srgb_from_linear(photos).transpose(0, 3, 1, 2), sides)
        calibration = self.calibration
        predicted = (
            softmax(heads.azimuth / calibration.azimuth_temperature),
            heads.mean * self.deviation + self.mean,
            np.exp(np.float32(0.5) * heads.log_variance) * self.deviation * calibration.deviation,
            mask_at_pixels(heads.mask / calibration.mask_temperature, *photos.shape[1:3]),
            heads.roll,
            sigmoid(heads.presence),
        )
        return Prediction(*(np.array(each, np.float32) for each in predicted))
