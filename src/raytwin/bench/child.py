"""One method tried in a process of its own, which can be stopped: a compiler cannot.

As a program: a pickled (method, scene) on standard input; on standard output, as JSON, the seconds of the first call
and of the second, or the reason why there is none. What Dr.Jit compiles here, its cache on disk keeps for the parent.
"""

import json
import pickle
import subprocess
import sys

from raytwin.bench.methods import Method
from raytwin.errors import InputError, MachineError
from raytwin.scene import Scene


def try_out(method: Method, scene: Scene, seconds: float) -> tuple[float, float]:
    """(first call, second call) in seconds. Raises InputError where the method cannot have it, or not in time."""
    command = [sys.executable, "-P", "-m", "raytwin.bench.child"]
    sent = pickle.dumps((method, scene))
    try:
        child = subprocess.run(command, input=sent, capture_output=True, timeout=max(seconds, 0.001), check=False)
    except subprocess.TimeoutExpired:
        raise MachineError(method.name, f"a first call within {seconds:.3g} s", "none") from None
    lines = child.stdout.decode(errors="replace").splitlines()
    if child.returncode or not lines:
        last = child.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no word"]
        raise MachineError(method.name, "a call that ends", last[0])
    answer = json.loads(lines[-1])
    if isinstance(answer, str):
        raise MachineError(method.name, "a machine that has it", answer)
    return tuple(answer)


def main() -> None:
    from raytwin.bench.methods import prepare
    from raytwin.bench.run import timed

    method, scene = pickle.load(sys.stdin.buffer)
    try:
        call = prepare(method, scene)
        answer = timed(call), timed(call)
    except InputError as error:
        answer = str(error)
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
