"""Run edited versions of a function, and return what each gives, in the sandbox or in this process.

The text of these functions is sent into the sandbox: each imports what it needs itself.
"""

from typing import Any


def attempt(
    space: Any, function: Any, codes: Any, names: Any, arguments: Any, seconds: Any, changed: Any = False
) -> Any:
    """Return what the function returns with each of `codes` run in `space`; `names`: what each code binds.

    A list of arrays or None: the function raised, took too long or changed its arguments. With `changed`, also None
    where the code changes nothing in what it returns. Afterwards every name is bound as before.
    """
    import contextlib
    import io
    import pickle
    import signal
    import threading
    import time
    import warnings

    import numpy

    def stop(number: Any, frame: Any) -> None:
        raise TimeoutError

    def answer(limit: float, code: Any) -> Any:
        try:
            if timed:
                signal.setitimer(signal.ITIMER_VIRTUAL, limit)
            if code is not None:
                exec(code, space)
            given = pickle.loads(stored)
            before = [pickle.dumps(one) for one in given if not isinstance(one, dict)]
            returned = space[function](*given)
            arrays = returned if isinstance(returned, tuple) else (returned,)
            if before != [pickle.dumps(one) for one in given if not isinstance(one, dict)]:
                return None
            return tuple(numpy.array(a, dtype=float) for a in arrays)
        except (Exception, SystemExit):  # a change that does not run is none
            return None
        finally:
            if timed:
                signal.setitimer(signal.ITIMER_VIRTUAL, 0)

    def comparable(arrays: Any) -> Any:
        return None if arrays is None else [(a.shape, a.tobytes()) for a in arrays]

    stored = pickle.dumps(arguments)
    timed = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
    previous_handler = signal.signal(signal.SIGVTALRM, stop) if timed else None
    answers = []
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings(), numpy.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        began = time.process_time()
        unchanged = comparable(answer(seconds, None))
        if unchanged is not None:
            seconds = min(seconds, 0.1 + 10 * (time.process_time() - began))
        for code, bound in zip(codes, names, strict=True):
            old = {name: space[name] for name in bound if name in space}
            arrays = None
            with contextlib.suppress(TimeoutError):  # the timer may fire after the answer, too
                arrays = answer(seconds, code)
            space.update(old)
            answers.append(None if changed and comparable(arrays) == unchanged else arrays)
    if timed:
        signal.signal(signal.SIGVTALRM, previous_handler)
    return answers


def lines_run(space: Any, function: Any, arguments: Any, seconds: Any) -> Any:
    """(name of the outermost function or class, line) -> how often one call runs that line of the text."""
    import sys
    import threading

    count: dict[tuple[str, int], int] = {}

    def in_frame(frame: Any, event: Any, argument: Any) -> Any:
        if event == "line":
            place = frame.f_code.co_qualname.partition(".")[0], frame.f_lineno
            count[place] = count.get(place, 0) + 1
        return in_frame

    def called(frame: Any, event: Any, argument: Any) -> Any:
        return in_frame if frame.f_globals is space else None

    def traced(*arguments: Any) -> Any:
        threading.settrace(called)
        sys.settrace(called)
        try:
            return space[function](*arguments)
        finally:
            sys.settrace(None)
            threading.settrace(None)

    previous_trace = sys.gettrace()
    space["raytwin_traced"] = traced
    attempt(space, "raytwin_traced", [], [], arguments, seconds)
    sys.settrace(previous_trace)
    return count
