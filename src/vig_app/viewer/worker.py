"""The thread that a page's corrections are made on."""

from __future__ import annotations

import threading
import time
import traceback
from collections import deque
from collections.abc import Callable

from vig.io.errors import UserError
from vig_app.viewer.session import Change, Session

Work = Callable[[], None]
ShowMessage = Callable[[str, bool], None]
"""Shows the user some words, and whether they are of what cannot be done."""


class Worker:
    """Makes corrections in their order, those made during a fit all at once, and other work between.

    A page's events come on many threads and faster than fits are made. Where some of several corrections
    cannot be made, these alone are reported and left out.
    """

    def __init__(self, session: Session, show: Callable[[], None], message: ShowMessage) -> None:
        """Start the thread.

        Args:
            session: Is corrected.
            show: Is called after corrections, on the thread.
            message: Is called there with what the user should read.
        """
        self.session = session
        self.show = show
        self.message = message
        self._waiting: deque[tuple[Change | None, Work | None]] = deque()
        self._changed = threading.Condition()
        self._busy = False
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="vig-view", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether anything is being done or waits."""
        return self._busy or bool(self._waiting)

    @property
    def corrections_wait(self) -> bool:
        """Whether there are corrections that are not made yet."""
        return any(work is None for _, work in [*self._waiting])

    def correct(self, change: Change | None) -> None:
        """Make a correction soon; None takes the last one back."""
        self._add(change, None)

    def do(self, work: Work) -> None:
        """Do something on the thread, after the corrections before it."""
        self._add(None, work)

    def stop(self) -> None:
        """End after what is being done; what waits is left."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()

    def _add(self, change: Change | None, work: Work | None) -> None:
        with self._changed:
            self._waiting.append((change, work))
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.wait_for(lambda: self._waiting or self._ended)
                if self._ended:
                    return
                self._busy = True
                changes: list[Change | None] = []
                while self._waiting and self._waiting[0][1] is None:
                    changes.append(self._waiting.popleft()[0])
                work = None if changes else self._waiting.popleft()[1]
            try:
                if work is not None:
                    work()
                else:
                    self._correct(changes)
            except Exception:  # a fault of ours must not leave the page without its thread
                traceback.print_exc()
                self.message("That went wrong; the terminal says more.", True)

    def _correct(self, changes: list[Change | None]) -> None:
        self.message("fitting ...", False)
        started = time.perf_counter()
        try:
            self.session.correct(*changes)
            refused = ""
        except UserError as error:
            refused = str(error) if len(changes) == 1 else self._one_by_one(changes)
        self.show()
        self.message(refused or f"fitted in {time.perf_counter() - started:.1f} s", bool(refused))

    def _one_by_one(self, changes: list[Change | None]) -> str:
        """Each by itself; the messages of those that are refused. Taking one of these back does nothing."""
        messages: list[str] = []
        refused = 0
        for change in changes:
            if change is None and refused:
                refused -= 1
                continue
            try:
                self.session.correct(change)
                refused = 0
            except UserError as error:
                refused += 1
                messages.append(str(error))
        return " ".join(dict.fromkeys(messages))
