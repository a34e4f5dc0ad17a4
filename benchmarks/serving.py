"""`vig serve` under load and under nonsense: `python -m benchmarks.serving [--seconds 600] [--json FILE]`.

Clients post a packaged example, one after the other, for so many seconds, while two others send slowly and
hang up; then requests of all kinds of nonsense are sent. Printed are requests a second, latencies, the growth
of the server's memory from a tenth of the time on, and the answers to the nonsense by their status.
"""

import argparse
import http.client
import os
import socket
import struct
import subprocess
import sys
import threading
import time
import zlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measuring import metric, report, write
from vig_app.examples import example_photos

CLIENTS, SECONDS, NONSENSE = 10, 600.0, 5000
BOUNDARY = "vig-boundary"
BOX = b"7,42,124,78"
Send = Callable[[str, str, dict[str, str], bytes], int]
"""Sends a method, path, headers and body, and returns the status."""


def form(fields: dict[str, tuple[str, bytes]]) -> tuple[dict[str, str], bytes]:
    """Headers and body of a form: by name a file's name, "" for a plain field, and the content."""
    body = b""
    for name, (file, content) in fields.items():
        given = f'; filename="{file}"' if file else ""
        body += f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="{name}"{given}\r\n\r\n'.encode()
        body += content + b"\r\n"
    body += f"--{BOUNDARY}--\r\n".encode()
    return {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}"}, body


def picture_header(width: int, height: int) -> bytes:
    """A PNG file of that size whose pixels are missing."""
    head = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = [head, b"IDAT" + zlib.compress(b"")]
    framed = (
        struct.pack(">I", len(each) - 4) + each + struct.pack(">I", zlib.crc32(each)) for each in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(framed)


def nonsense(rng: np.random.Generator) -> tuple[str, str, dict[str, str], bytes]:
    """A request that a broken or hostile client may send: none deserves an explanation."""
    photo = example_photos()[0].photo.read_bytes()
    noise = rng.bytes(int(rng.integers(0, 4000)))
    damaged = bytearray(photo)
    for at in rng.integers(0, 400, 20):
        damaged[at] = int(rng.integers(0, 256))
    files = [
        noise,
        bytes(damaged),
        photo[: int(rng.integers(0, len(photo) // 2))],
        picture_header(20_000, 10_000),
        b"",
        b"%PDF-1.7",
        b"<svg/>",
    ]
    content = files[rng.integers(len(files))]
    names = ["a.png", "../../etc/passwd", "/dev/zero", "a\x00b", "x" * 300, "C:\\boot.ini", "%2e%2e%2f"]
    fields = {"photo": (names[rng.integers(len(names))], content)}
    if rng.random() < 0.5:
        texts = [b"1,2,3", b"-5,-5,0,0", b"nan,0,1,1", b"1e999,0,1,1", noise[:40], b"[]", b"0,0,9999999999,1"]
        fields["box"] = ("", texts[rng.integers(len(texts))])
        fields["photo"] = ("a.png", photo)
    if rng.random() < 0.3:
        fields["class"] = ("", [b"dog", b"../teapot", noise[:20], b"x" * 5000][rng.integers(4)])
    if rng.random() < 0.2:
        fields["mask"] = ("m.png", files[rng.integers(len(files))])
    headers, body = form(fields)
    if rng.random() < 0.2:
        headers["Content-Type"] = ["text/plain", "multipart/form-data", "", "application/json", "\xff"][
            rng.integers(5)
        ]
    if rng.random() < 0.2:
        body = body[: int(rng.integers(0, len(body)))]
    paths = [
        "/explain", "/explain/mask.png", "/explain/../../etc/passwd", "/explain/%2e%2e%2fpasswd", "/predict",
        "/setup", "/" + "a" * 3000, "/explain?x=" + "%00" * 20,
    ]  # fmt: skip
    path = paths[rng.integers(len(paths))]
    if path in ("/predict", "/setup") and rng.random() < 0.7:
        headers = {"Content-Type": "application/json"}
        address = b'{"tasks": [{"data": {"image": "%b"}}, null], "label_config": "<View/>"}'
        tasks = [b"{}", b"[]", b"{", b"[" * 5000, b'{"tasks": 3}', address % b"file:///etc/passwd"]
        tasks += [address % b"data:image/png;base64,AAAA", address % b"http://169.254.169.254/"]
        body = tasks[rng.integers(len(tasks))]
    return ["POST", "POST", "POST", "POST", "PUT", "GET", "DELETE"][rng.integers(7)], path, headers, body


def statuses(send: Send, count: int, seed: int) -> Counter[int]:
    """How many of so many requests of nonsense were answered with each status."""
    rng = np.random.default_rng(seed)
    return Counter(send(*nonsense(rng)) for _ in range(count))


def sender(port: int) -> Send:
    """Sends each request over a connection of its own; 0 is the status of one that is not answered."""

    def send(method: str, path: str, headers: dict[str, str], body: bytes) -> int:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        try:
            connection.putrequest(method, path.encode("ascii", "replace").decode().replace(" ", "%20"))
            for name, value in {**headers, "Content-Length": str(len(body))}.items():
                connection.putheader(name, value.encode("latin-1", "replace"))
            connection.endheaders(body)
            answer = connection.getresponse()
            answer.read()
            return answer.status
        except (OSError, http.client.HTTPException):
            return 0
        finally:
            connection.close()

    return send


def memory_of(process: int) -> float:
    """Resident memory of a process, MiB."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def load(
    port: int, process: int, clients: int, seconds: float
) -> tuple[list[float], Counter[int], list[float]]:
    """Latencies of requests, their statuses, and the server's memory along the way."""
    headers, body = form({"photo": ("a.png", example_photos()[0].photo.read_bytes()), "box": ("", BOX)})
    send, until = sender(port), time.monotonic() + seconds
    latencies, answers, memory = list[float](), Counter[int](), list[float]()

    def client() -> None:
        while time.monotonic() < until:
            begun = time.monotonic()
            answers[send("POST", "/explain", headers, body)] += 1
            latencies.append(time.monotonic() - begun)

    def broken() -> None:
        head = f"POST /explain HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {len(body)}\r\n"
        head += f"Content-Type: {headers['Content-Type']}\r\n\r\n"
        while time.monotonic() < until:
            with socket.create_connection(("127.0.0.1", port)) as slow:
                slow.sendall(head.encode() + body[:500])
                for place in range(500, 520):
                    if time.monotonic() < until:
                        slow.sendall(body[place : place + 1])
                        time.sleep(0.1)

    threads = [threading.Thread(target=work) for work in [client] * clients + [broken] * 2]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        memory.append(memory_of(process))
        time.sleep(min(1.0, seconds / 20))
    return latencies, answers, memory


def started(options: list[str]) -> tuple[subprocess.Popen[bytes], int]:
    """A server on a free port that answers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "vig", "serve", "--port", str(port), "--per-minute", "1000000", *options]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    for _ in range(600):
        if sender(port)("GET", "/health", {}, b"") == 200:
            return server, port
        time.sleep(0.1)
    server.kill()
    raise RuntimeError("vig serve did not answer within a minute")


def main(given: list[str] | None = None) -> dict[str, Any]:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--clients", type=int, default=CLIENTS)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--nonsense", type=int, default=NONSENSE, help="requests of nonsense after the load")
    arguments = parser.parse_args(given)
    server, port = started([])
    try:
        latencies, answers, memory = load(port, server.pid, arguments.clients, arguments.seconds)
        refused = statuses(sender(port), arguments.nonsense, seed=0)
        alive = sender(port)("GET", "/health", {}, b"") == 200
    finally:
        server.terminate()
        server.wait()
    begin = len(memory) // 10
    growth = float(np.median(memory[-begin - 1 :]) - np.median(memory[begin : 2 * begin + 1]))
    metrics = [
        metric("requests_per_s", [answers[200] / arguments.seconds], "1/s", "higher"),
        metric("latency_s", latencies, "s"),
        metric("latency_95_s", [np.percentile(latencies, 95)], "s"),
        metric("lost", [answers.total() - answers[200]], "requests"),
        metric("memory_growth_mib", [growth], "MiB"),
        metric("memory_mib", [max(memory)], "MiB"),
        metric(
            "nonsense_unanswered_or_5xx",
            [sum(n for s, n in refused.items() if not 200 <= s < 500)],
            "requests",
        ),
    ]
    for each in metrics:
        print(f"{each['name']}: {each['value']} {each['unit']}")
    print(
        f"answers {dict(answers)}; to nonsense {dict(sorted(refused.items()))};"
        f" {'alive' if alive else 'DEAD'} after it"
    )
    found = report(metrics, threads=os.cpu_count() or 1, packages=["fastapi", "uvicorn"])
    if arguments.json:
        write(found, arguments.json)
    return found


if __name__ == "__main__":
    main()
