"""Corrections of a page are made in turn, together where they came together, and none is lost."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest

from vig.io.errors import UserError
from vig_app.corrections import State
from vig_app.viewer.session import Change, placed
from vig_app.viewer.worker import Worker


class Fitting:
    """A session that notes what it fits, waits until it may, and takes no elevation above 90."""

    def __init__(self) -> None:
        self.states, self.fitted, self.may = [State()], list[State](), threading.Event()

    def correct(self, *changes: Change | None) -> None:
        assert self.may.wait(10)
        states = [*self.states]
        for change in changes:
            if change is None:
                states = states[:-1] or states
            else:
                states.append(change(states[-1]))
        self.fitted.append(states[-1])
        if (states[-1].elevation_deg or 0.0) > 90:
            raise UserError("expected an elevation of at most 90")
        if states[-1].roll_deg == 7.0:
            raise ZeroDivisionError
        self.states = states


def elevated(degrees: float) -> Change:
    return lambda state: replace(state, elevation_deg=degrees)


@pytest.fixture
def begun() -> tuple[Worker, Fitting, list[str]]:
    """A worker that has begun with one correction and waits within it."""
    session, messages, started = Fitting(), list[str](), threading.Event()

    def tell(words: str, refused: bool = False) -> None:
        messages.append(f"no: {words}" if refused else words)
        started.set()

    worker = Worker(session, lambda: None, tell)  # type: ignore[arg-type]
    worker.correct(elevated(10.0))
    assert started.wait(10) and worker.busy
    return worker, session, messages


def finished(worker: Worker, session: Fitting) -> None:
    done = threading.Event()
    worker.do(done.set)
    session.may.set()
    assert done.wait(10)


def test_what_came_during_a_fit_is_fitted_at_once(begun: tuple[Worker, Fitting, list[str]]) -> None:
    worker, session, messages = begun
    for degrees in (20.0, 30.0, 40.0):
        worker.correct(elevated(degrees))
    worker.correct(None)
    assert worker.corrections_wait
    finished(worker, session)
    assert [state.elevation_deg for state in session.fitted] == [10.0, 30.0]
    assert [state.elevation_deg for state in session.states] == [None, 10.0, 20.0, 30.0]
    assert messages[-1].startswith("fitted in")
    worker.stop()
    assert not worker._thread.is_alive()


def test_of_several_only_what_cannot_be_made_is_left_out(
    begun: tuple[Worker, Fitting, list[str]],
) -> None:
    worker, session, messages = begun
    worker.correct(placed("spout", 1.0, 2.0))
    worker.correct(elevated(100.0))
    finished(worker, session)
    assert session.states[-1] == State(points={"spout": (1.0, 2.0)}, elevation_deg=10.0)
    assert messages[-1] == "no: expected an elevation of at most 90"
    worker.stop()


def test_taking_back_what_was_refused_meanwhile_takes_nothing_else_back(
    begun: tuple[Worker, Fitting, list[str]],
) -> None:
    worker, session, _ = begun
    for change in (placed("spout", 1.0, 2.0), elevated(100.0), elevated(200.0), None, None):
        worker.correct(change)
    finished(worker, session)
    assert session.states[-1] == State(points={"spout": (1.0, 2.0)}, elevation_deg=10.0)
    worker.correct(None)
    finished(worker, session)
    assert session.states[-1] == State(elevation_deg=10.0)
    worker.stop()


def test_a_fault_is_told_and_the_thread_goes_on(
    begun: tuple[Worker, Fitting, list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    worker, session, messages = begun
    worker.correct(lambda state: replace(state, roll_deg=7.0))
    finished(worker, session)
    assert "went wrong" in messages[-1] and "ZeroDivisionError" in capsys.readouterr().err
    worker.correct(elevated(50.0))
    finished(worker, session)
    assert session.states[-1].elevation_deg == 50.0
    worker.stop()
