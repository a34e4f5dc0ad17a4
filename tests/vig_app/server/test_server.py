"""`vig serve`: answers, limits, Label Studio's protocol, and nonsense."""

import asyncio
import base64
import socket
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

pytest.importorskip("fastapi")
pytest.importorskip("httpx2")

from fastapi.testclient import TestClient

import vig
from benchmarks.serving import picture_header, statuses
from vig.inference import Verdict
from vig_app.cli.common import ServeCommand
from vig_app.cli.serve import serve
from vig_app.examples import example_photos
from vig_app.server.app import Service, app_of
from vig_app.server.label_studio import fetch
from vig_app.server.limits import Limits

PHOTO = example_photos()[1].photo
BOX = "35,39,80,79"
CONFIG = """<View><Image name="image" value="$photo"/>
<PolygonLabels name="mask" toName="image"><Label value="Teapot"/><Label value="teapot amodal"/>
</PolygonLabels>
<RectangleLabels name="box" toName="image"><Label value="teapot"/><Label value="dog"/></RectangleLabels>
<KeyPointLabels name="point" toName="image"><Label value="spout"/></KeyPointLabels></View>"""


@pytest.fixture(scope="module")
def service() -> Service:
    return Service(("teapot",))


@pytest.fixture
def client(service: Service) -> Iterator[TestClient]:
    with TestClient(app_of(service), base_url="http://localhost") as client:
        yield client


def post(client: TestClient, path: str = "/explain", photo: bytes | None = None, **fields: str) -> Any:
    data = PHOTO.read_bytes() if photo is None else photo
    return client.post(path, files={"photo": ("../../a.png", data)}, data={"box": BOX} | fields)


def test_a_photo_is_answered_as_the_library_explains_it(client: TestClient) -> None:
    expected = vig.Explainer("teapot").explain(PHOTO, (35, 39, 80, 79)).to_dict()
    answer = post(client)
    assert answer.status_code == 200
    assert answer.json()["azimuth_deg"] == pytest.approx(expected["azimuth_deg"], abs=0.1)
    assert answer.json().keys() == expected.keys()


def test_files_of_the_result_come_as_they_are_asked_for(client: TestClient) -> None:
    glb = post(client, "/explain/object.glb")
    assert glb.headers["content-type"] == "model/gltf-binary" and glb.content[:4] == b"glTF"
    assert glb.headers["x-vig-verdict"] == post(client).json()["verdict"] in {str(each) for each in Verdict}
    mask = post(client, "/explain/mask.png")
    assert mask.headers["content-type"] == "image/png" and mask.content[1:4] == b"PNG"
    assert post(client, "/explain/explanation.key").status_code == 422


def test_a_mask_is_taken(client: TestClient) -> None:
    mask = post(client, "/explain/mask.png").content
    files = {"photo": ("a.png", PHOTO.read_bytes()), "mask": ("m.png", mask)}
    answer = client.post("/explain", files=files).json()
    assert answer["hints"]["mask"] > 1000


def test_health_and_openapi_name_what_there_is(client: TestClient) -> None:
    health = client.get("/health").json()
    assert health == {"status": "UP", "vig": vig.__version__, "classes": ["teapot"]}
    paths = client.get("/openapi.json").json()["paths"]
    assert paths.keys() == {"/health", "/explain", "/explain/{file}", "/setup", "/predict"}


@pytest.mark.parametrize(
    "status, words, photo, fields",
    [
        (415, "expected a photo", b"no picture at all", {}),
        (415, "photo", PHOTO.read_bytes()[:2000], {}),
        (413, "pixels", picture_header(20_000, 10_000), {}),
        (422, "expected a box", None, {"box": "1,2,3"}),
        (422, "expected a class of teapot; got 'dog'", None, {"class": "dog"}),
        (422, "photo, box, mask and class; got 'boxes', 'focal'", None, {"boxes": "1", "focal": "500"}),
    ],
    ids=["text", "cut", "huge", "box", "class", "others"],
)
def test_what_cannot_be_explained_is_refused_in_a_line(
    client: TestClient, status: int, words: str, photo: bytes | None, fields: dict[str, str]
) -> None:
    answer = post(client, photo=photo, **fields)
    assert answer.status_code == status
    assert (
        words in answer.json()["error"] and "/tmp" not in answer.text and "\n" not in answer.json()["error"]
    )


def test_requests_of_another_kind_are_refused(client: TestClient) -> None:
    assert client.post("/explain", content=b"x", headers={"Content-Type": "text/plain"}).status_code == 415
    assert client.post("/explain", data={"box": BOX}).status_code == 415  # a form of another kind
    assert client.post("/explain", files={"box": b"1"}).status_code == 422
    answer = client.post("/explain?box=1,2,30,40", files={"photo": PHOTO.read_bytes()})
    assert answer.status_code == 422 and answer.json()["error"].endswith("got 'box'.")


def test_pages_of_other_sites_are_refused(service: Service, client: TestClient) -> None:
    assert client.get("/health", headers={"Origin": "http://evil.example"}).status_code == 403
    assert client.get("/health", headers={"Origin": "http://localhost"}).status_code == 200
    assert client.get("/health", headers={"Host": "rebound.example"}).status_code == 403


def test_a_key_is_asked_for(service: Service) -> None:
    client = TestClient(app_of(service, key="secret"))
    assert client.get("/health").status_code == 200
    assert post(client).status_code == 401
    basic = base64.b64encode(b"vig:secret").decode()
    for name, value in (
        ("X-API-Key", "secret"),
        ("Authorization", "Bearer secret"),
        ("Authorization", f"Basic {basic}"),
    ):
        assert client.post("/setup", json={}, headers={name: value}).status_code == 200
    for value in ("Basic ?", "Bearer secre", "Basic c2VjcmV0"):
        assert client.post("/setup", json={}, headers={"Authorization": value}).status_code == 401


def test_a_server_beyond_this_machine_needs_a_key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("VIG_KEY", raising=False)
    for host in ("0.0.0.0", "example.org"):
        with pytest.raises(vig.UserError, match=f"expected --key with --host {host}"):
            serve(ServeCommand(host=host))


def test_a_port_that_is_taken_is_named_in_a_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        with pytest.raises(vig.UserError, match="cannot listen at 127.0.0.1, port .*Name another"):
            serve(ServeCommand(port=other.getsockname()[1]))
    with pytest.raises(vig.UserError, match="cannot listen at 127.0.0.1, port 70000"):
        serve(ServeCommand(port=70_000))


def test_size_and_rate_are_limited(service: Service) -> None:
    client = TestClient(app_of(service, most_bytes=5000, per_minute=3), base_url="http://localhost")
    assert post(client).status_code == 413
    chunks = (bytes(2000) for _ in range(4))
    kind = {"Content-Type": "multipart/form-data; boundary=b"}
    assert client.post("/explain", content=chunks, headers=kind).status_code == 413
    assert client.post("/setup", headers={"Content-Length": "10000000000"}, content=b"").status_code == 413
    refused = client.get("/health")
    assert refused.status_code == 429 and 0 < int(refused.headers["Retry-After"]) <= 60


def test_a_request_that_does_not_come_in_time_is_refused(service: Service) -> None:
    sent: list[dict[str, Any]] = []

    async def silent() -> dict[str, Any]:
        await asyncio.sleep(60)
        return {}

    async def take(message: Any) -> None:
        sent.append(message)

    headers = [(b"host", b"localhost"), (b"content-type", b"application/json")]
    scope = {"type": "http", "method": "POST", "path": "/setup", "headers": headers, "query_string": b""}
    scope |= {
        "client": ("127.0.0.1", 1),
        "scheme": "http",
        "server": ("localhost", 80),
        "raw_path": b"/setup",
    }
    asyncio.run(Limits(app_of(service), seconds=0.05)(scope, silent, take))  # type: ignore[arg-type]
    assert sent[0]["status"] == 408


def test_label_studio_gets_the_shapes_that_its_configuration_has(client: TestClient) -> None:
    url = "data:image/png;base64," + base64.b64encode(PHOTO.read_bytes()).decode()
    tasks = [{"id": 1, "data": {"photo": url}}, {"id": 2, "data": {"photo": "http://elsewhere/a.png"}}]
    assert client.post("/setup", json={"project": "1", "schema": CONFIG}).json()["model_version"]
    pytest.importorskip("cv2")
    first, second = client.post("/predict", json={"tasks": tasks, "label_config": CONFIG}).json()["results"]
    assert second["result"] == [] and "got 'http://elsewhere/a.png'" in second["error"]
    with suppress(ImportError):
        from label_studio_sdk.label_interface import LabelInterface

        assert LabelInterface(CONFIG).validate_prediction(first, return_errors=True) == []
    labels = {(one["from_name"], one["value"][one["type"]][0]) for one in first["result"]}
    assert labels == {("mask", "Teapot"), ("mask", "teapot amodal"), ("box", "teapot"), ("point", "spout")}
    assert 0 < first["score"] <= 1
    (box,) = (one for one in first["result"] if one["type"] == "rectanglelabels")
    assert box["to_name"] == "image" and (box["original_width"], box["original_height"]) == (150, 150)
    numbers = np.array([box["value"][side] for side in ("x", "y", "width", "height")]) * 1.5
    np.testing.assert_allclose(numbers, (35, 39, 80, 79), atol=12)


@pytest.mark.parametrize(
    "url",
    ["http://169.254.169.254/", "file:///etc/passwd", "//evil.example/a.png", "http://ls.example.evil/a"],
)
def test_photos_are_fetched_from_label_studio_alone(url: str) -> None:
    with pytest.raises(vig.UserError, match="expected a photo of http://ls.example; got"):
        fetch({"data": {"text": "a", "image": url}}, "<Image value='$image'/>", "http://ls.example", None)


def test_nonsense_gets_one_of_the_four_hundreds(client: TestClient) -> None:
    def send(method: str, path: str, headers: dict[str, str], body: bytes) -> int:
        given = {name: value.encode("latin-1") for name, value in headers.items()}
        status: int = client.request(method, path, headers=given, content=body).status_code
        return status

    counts = statuses(send, 150, seed=1)
    assert counts.total() == 150 and all(200 <= status < 500 for status in counts)
