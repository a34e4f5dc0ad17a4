"""First uses by several threads at once, in processes of their own."""

import os
import subprocess
import sys

import pytest

FIRST_USES = """
import sys, threading
from dataclasses import dataclass
import numpy as np, torch
from vig.io.checks import decode
from vig.renderer import MeshObject, Pinhole, Scene, Topology, render

@dataclass(frozen=True)
class Leaf:
    numbers: tuple[float, ...]

@dataclass(frozen=True)
class Tree:
    leaves: dict[str, Leaf]
    more: tuple["Tree", ...] = ()

def work():
    tree = {"leaves": {"a": {"numbers": [1.0]}}}
    assert decode(Tree, tree | {"more": [tree]}).more[0].leaves["a"] == Leaf((1.0,))
    corners = torch.tensor([[0.0, 0, 1], [0.5, 0, 1], [0, 0.5, 1]])
    camera = Pinhole(8, 8, torch.tensor([8.0, 8]), torch.tensor([1.0, 1]), torch.eye(3), torch.zeros(3))
    drawn = render(Scene([MeshObject(corners, Topology.of([[0, 1, 2]], corners), torch.ones(3))], camera))
    results.append(float(drawn.coverage.sum()))

results, start = [], threading.Barrier(8)
sys.setswitchinterval(1e-6)
threads = [threading.Thread(target=lambda: (start.wait(), work())) for _ in range(8)]
for each in threads: each.start()
for each in threads: each.join()
assert len(results) == 8 and len(set(results)) == 1, results
"""


def test_threads_may_come_first_together() -> None:
    made = subprocess.run([sys.executable, "-c", FIRST_USES], capture_output=True, text=True, timeout=300)
    assert made.returncode == 0, made.stderr[-2000:]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_child_that_was_forked_beside_a_holder_can_read_files() -> None:
    code = """
import os, threading, time
from vig.io.checks import _LEARNING
held = threading.Event()
def hold():
    with _LEARNING:
        held.set()
        time.sleep(0.2)
threading.Thread(target=hold).start()
held.wait()
if (child := os.fork()) == 0:
    free = []
    thread = threading.Thread(target=lambda: free.append(_LEARNING.acquire(timeout=5)))
    thread.start()
    thread.join()
    os._exit(0 if free == [True] else 1)
assert os.waitpid(child, 0)[1] == 0
"""
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
