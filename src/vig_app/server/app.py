"""The application of `vig serve`: photos posted, explanations returned; Label Studio's backend beside it."""

import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from threading import BoundedSemaphore
from typing import Annotated, Any, Literal, TypeVar

from fastapi import Depends, FastAPI, File, Form, HTTPException, Request, UploadFile
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from PIL import Image
from starlette.exceptions import HTTPException as StarletteError

from vig import __version__
from vig.explainer import Explainer, check_box
from vig.explanation import Explanation
from vig.hints import Hints
from vig.io.errors import UserError
from vig.photo.checks import check_pixels
from vig.photo.images import read_picture
from vig.photo.masks import read_mask
from vig_app.server.label_studio import fetch, prediction
from vig_app.server.limits import Limits

Result = TypeVar("Result")
KINDS = {"png": "image/png", "glb": "model/gltf-binary", "html": "text/html"}
"""Media types of files of an explanation, by their endings."""
MAX_PIXELS = 50_000_000  # pixels of a picture: more would take a gigabyte
WAITING = 32  # requests that may wait for the one that is fitted


class Posted:
    """The fields of a form, as `Service.answer` takes them."""

    def __init__(
        self,
        photo: Annotated[UploadFile, File(description="JPEG, PNG, TIFF, WebP, AVIF ...")],
        box: Annotated[str, Form(description="x,y,w,h in pixels round the whole object")] = "",
        mask: Annotated[UploadFile | None, File(description="white where the object is seen")] = None,
        name: Annotated[str, Form(alias="class", description="a class of /health")] = "",
    ):
        self.given = photo.file.read(), box, None if mask is None else mask.file.read(), name


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
        self.label_studio, self.token = label_studio, token
        self._thread, self._places = ThreadPoolExecutor(1), BoundedSemaphore(WAITING)

    def answer(
        self,
        make: Callable[[Explanation, Path], Result],
        photo: bytes,
        box: str = "",
        mask: bytes | None = None,
        name: str = "",
    ) -> Result:
        """Return what is made of the explanation of a photo, with a folder to write into.

        Raises HTTPException or UserError, which names no file of ours, where it cannot be explained.
        """
        if not self._places.acquire(blocking=False):
            words = f"expected at most {WAITING} photos at a time; got more."
            raise HTTPException(503, words, {"Retry-After": "5"})
        try:
            with tempfile.TemporaryDirectory() as folder:
                for file, data in (("photo", photo), ("mask", mask)):
                    if data is not None:
                        (Path(folder) / file).write_bytes(data)

                def work() -> Result:
                    return make(self._explain(Path(folder), name, box), Path(folder))

                try:
                    return self._thread.submit(work).result()
                except UserError as error:
                    raise UserError(str(error).replace(f"{folder}/", "")) from None
        finally:
            self._places.release()

    def _explain(self, folder: Path, name: str, box: str) -> Explanation:
        photo, mask = folder / "photo", folder / "mask"
        if (explainer := self.explainers.get(name or next(iter(self.explainers)))) is None:
            raise UserError(f"expected a class of {', '.join(self.explainers)}; got '{name}'.")
        for path in (path for path in (photo, mask) if path.exists()):
            try:
                read_picture(path, path.name, _check)
            except UserError as error:
                words = str(error).replace(f"{folder}/", "")
                raise HTTPException(413 if "pixels" in words else 415, words) from None
        hints = Hints(mask=read_mask(mask)) if mask.exists() else None
        return explainer.explain(photo, check_box(box.split(",")) if box else None, hints=hints)


def _check(path: Path, image: Image.Image) -> None:
    check_pixels(path, *image.size, MAX_PIXELS)
    image.load()


def refuse(request: Request, error: Exception) -> JSONResponse:
    """Return a line on an error of the user's."""
    if isinstance(error, StarletteError):
        return JSONResponse({"error": str(error.detail)[:300]}, error.status_code, error.headers)
    if not isinstance(error, RequestValidationError):
        return JSONResponse({"error": str(error)}, 422)
    first, kind = error.errors()[0], request.headers.get("content-type", "")
    words = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"[:200]
    status = 422 if kind.startswith(("multipart/form-data", "application/json")) else 415
    return JSONResponse({"error": f"expected a form or JSON that suits; got {words}."}, status)


async def check_fields(request: Request) -> None:
    """Raise UserError for fields that a form does not have, or query parameters."""
    others = {*await request.form()} - {"photo", "box", "mask", "class"} | {*request.query_params}
    if others:
        words = "expected the form's fields photo, box, mask and class"
        raise UserError(f"{words}; got {', '.join(map(repr, sorted(others)))[:80]}.")


def app_of(service: Service, **limits: Any) -> FastAPI:
    """Return the application; `limits` are those of `Limits`."""
    app = FastAPI(title="vig", version=__version__, description="Explains an object in a photo.")
    app.add_middleware(Limits, **limits)
    for kind in (UserError, RequestValidationError, StarletteError):
        app.add_exception_handler(kind, refuse)

    @app.get("/health")
    def health() -> dict[str, Any]:
        """Return the version and the classes."""
        return {"status": "UP", "vig": __version__, "classes": [*service.explainers]}

    @app.post("/explain", dependencies=[Depends(check_fields)])
    def explain(posted: Annotated[Posted, Depends()]) -> dict[str, Any]:
        """Return what explanation.json holds."""
        return service.answer(lambda explanation, folder: explanation.to_dict(), *posted.given)

    @app.post("/explain/{file}", response_class=Response, dependencies=[Depends(check_fields)])
    def explain_as(
        file: Literal["mask.png", "overlay.png", "object.glb", "report.html"],
        posted: Annotated[Posted, Depends()],
    ) -> Response:
        """Return a file of the result."""

        def make(explanation: Explanation, folder: Path) -> Response:
            data = (explanation.save(folder / "result", "photo", [file]) / file).read_bytes()
            verdict = {"X-Vig-Verdict": str(explanation.verdict)}
            return Response(data, headers=verdict, media_type=KINDS[file.rpartition(".")[2]])

        return service.answer(make, *posted.given)

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
        results = []
        for task in tasks:
            try:
                data = fetch(task, config, service.label_studio, service.token)
                results.append(service.answer(partial(prediction, config=config), data))
            except (HTTPException, UserError) as error:  # the other tasks go on
                words = str(getattr(error, "detail", error))
                results.append(setup({}) | {"result": [], "score": 0.0, "error": words})
        return {"results": results}

    return app
