"""The application of `vig serve`: photos posted, explanations returned; Label Studio's backend beside it."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from threading import BoundedSemaphore
from typing import Annotated, Any, Literal, TypeVar

from fastapi import FastAPI, File, Form, HTTPException, Request, UploadFile
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from PIL import Image
from starlette.exceptions import HTTPException as StarletteError

from vig import __version__
from vig.explainer import Explainer, checked_box
from vig.explanation import Explanation
from vig.hints import Hints
from vig.io.errors import UserError
from vig.photo.checks import check_pixels
from vig.photo.images import read_picture
from vig.photo.masks import read_mask
from vig_app.server.label_studio import fetch, prediction
from vig_app.server.limits import Limits

Result = TypeVar("Result")
KINDS = {
    "mask.png": "image/png", "overlay.png": "image/png", "object.glb": "model/gltf-binary",
    "report.html": "text/html",
}  # fmt: skip
"""Files of an explanation that can be asked for, and their media types."""
Photo = Annotated[UploadFile, File(description="JPEG, PNG, TIFF, WebP, AVIF ...")]
Box = Annotated[str, Form(description="x,y,w,h in pixels round the whole object")]
Mask = Annotated[UploadFile | None, File(description="white where the object is seen")]
Class = Annotated[str, Form(alias="class", description="a class of /health")]
"""Fields of a form."""
MOST_PIXELS = 50_000_000
"""Pixels of a picture: more would take a gigabyte."""
WAITING = 32
"""Requests that may wait for the one that is fitted."""


class Service:
    """Explainers of some classes, and a thread that fits photos one after the other.

    Args:
        classes: Names or folders of class packs, the default first.
        label_studio: Address of Label Studio whose photos may be fetched; None for none.
        token: Its access token.
    """

    def __init__(self, classes: tuple[str, ...], label_studio: str | None = None, token: str | None = None):
        explainers = [Explainer(name) for name in classes]
        self.explainers = {each.object_class.name: each for each in explainers}
        self.default = explainers[0].object_class.name
        self.label_studio, self.token = label_studio, token
        self._thread, self._places = ThreadPoolExecutor(1), BoundedSemaphore(WAITING)

    def fit(self, work: Callable[[], Result]) -> Result:
        """Return the result of some work after the work before it; 503 where too much waits."""
        if not self._places.acquire(blocking=False):
            raise HTTPException(
                503, f"expected at most {WAITING} photos at a time; got more.", {"Retry-After": "5"}
            )
        try:
            return self._thread.submit(work).result()
        finally:
            self._places.release()

    def explain(self, folder: Path, name: str | None, box: str | None = None) -> Explanation:
        """Explain folder/photo, with folder/mask where it is; HTTPException or UserError where it fails."""
        photo, mask = folder / "photo", folder / "mask"
        explainer = self.explainers.get(name or self.default)
        if explainer is None:
            raise UserError(f"expected a class of {', '.join(self.explainers)}; got '{name}'.")
        for path in (photo, mask):
            if path.exists():
                try:
                    read_picture(path, path.name, _check)
                except UserError as error:
                    words = str(error).replace(f"{folder}/", "")
                    raise HTTPException(413 if "pixels" in words else 415, words) from None
        hints = Hints(mask=read_mask(mask)) if mask.exists() else None
        return explainer.explain(photo, checked_box(box.split(",")) if box else None, hints=hints)


def _check(path: Path, image: Image.Image) -> None:
    check_pixels(path, *image.size, MOST_PIXELS)
    image.load()


def app_of(service: Service, **limits: Any) -> FastAPI:
    """Return the application; `limits` are those of `Limits`."""
    app = FastAPI(title="vig", version=__version__, description="Explains an object in a photo.")
    app.add_middleware(Limits, **limits)

    @app.exception_handler(UserError)
    def refuse(request: Request, error: UserError) -> JSONResponse:
        return JSONResponse({"error": str(error)}, 422)

    @app.exception_handler(RequestValidationError)
    def refuse_fields(request: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        place, words = ".".join(map(str, first["loc"])), str(first["msg"])[:200]
        kind = request.headers.get("content-type", "")
        status = 422 if kind.startswith(("multipart/form-data", "application/json")) else 415
        return JSONResponse({"error": f"expected a form or JSON that suits; got {place}: {words}."}, status)

    @app.exception_handler(StarletteError)
    def refuse_request(request: Request, error: StarletteError) -> JSONResponse:
        return JSONResponse({"error": str(error.detail)[:300]}, error.status_code, error.headers)

    @app.get("/health")
    def health() -> dict[str, Any]:
        """Return the version and the classes."""
        return {"status": "UP", "vig": __version__, "classes": [*service.explainers]}

    def answer(
        make: Callable[[Explanation, Path], Result], photo: bytes, box: str, mask: bytes | None, name: str
    ) -> Result:
        """Return what is made of the explanation of a photo, with a folder to write into."""
        with tempfile.TemporaryDirectory() as folder:
            for file, data in (("photo", photo), ("mask", mask)):
                if data is not None:
                    (Path(folder) / file).write_bytes(data)

            def work() -> Result:
                return make(service.explain(Path(folder), name, box), Path(folder))

            try:
                return service.fit(work)
            except UserError as error:  # which names no file of ours
                raise UserError(str(error).replace(f"{folder}/", "")) from None

    @app.post("/explain")
    def explain(photo: Photo, box: Box = "", mask: Mask = None, name: Class = "") -> dict[str, Any]:
        """Return what explanation.json holds."""
        data = None if mask is None else mask.file.read()
        return answer(lambda explanation, folder: explanation.to_dict(), photo.file.read(), box, data, name)

    @app.post("/explain/{file}", response_class=Response)
    def explain_as(
        file: Literal["mask.png", "overlay.png", "object.glb", "report.html"],
        photo: Photo, box: Box = "", mask: Mask = None, name: Class = "",
    ) -> Response:  # fmt: skip
        """Return a file of the result."""

        def make(explanation: Explanation, folder: Path) -> bytes:
            return (explanation.save(folder / "result", "photo", [file]) / file).read_bytes()

        data = None if mask is None else mask.file.read()
        return Response(answer(make, photo.file.read(), box, data, name), media_type=KINDS[file])

    @app.post("/setup")
    def setup(request: dict[str, Any]) -> dict[str, str]:
        """Return the version to Label Studio."""
        return {"model_version": f"vig {__version__}"}

    @app.post("/predict")
    def predict(request: dict[str, Any]) -> dict[str, Any]:
        """Return pre-annotations of Label Studio's tasks, by the tags of its labelling configuration."""
        tasks, config = request.get("tasks"), request.get("label_config")
        if not isinstance(tasks, list) or not isinstance(config, str):
            raise UserError("expected tasks and label_config of Label Studio; got neither or others.")
        return {"results": [_predicted(service, answer, task, config) for task in tasks]}

    return app


def _predicted(service: Service, answer: Callable[..., Any], task: Mapping[str, Any], config: str) -> Any:
    """Return the prediction of one task, empty where its photo cannot be used: others go on."""
    try:
        data = fetch(task, service.label_studio, service.token)
        return answer(partial(prediction, config=config), data, "", None, "")
    except (HTTPException, UserError) as error:
        words = str(getattr(error, "detail", error))
        return {"result": [], "score": 0.0, "model_version": f"vig {__version__}", "error": words}
