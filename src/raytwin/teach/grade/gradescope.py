"""autograder.zip as Gradescope takes it: its root becomes /autograder/source, where setup.sh runs once and
/autograder/run_autograder for each submission.

References lie inside, so that nothing is rendered by Mitsuba there; a submission sees neither them nor the results:
another uid, and no rights for others on both folders.
"""

import shlex
import zipfile
from importlib.metadata import version
from pathlib import Path

from raytwin.errors import InputError
from raytwin.safe_write import replacing
from raytwin.teach.grade.questions import references_of
from raytwin.teach.grade.rubric import read_rubric

SETUP = """#!/usr/bin/env bash
# Run once, as root, when the image is built.
set -euo pipefail
base="${RAYTWIN_AUTOGRADER:-/autograder}"
if ! python3 -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
  apt-get update
  apt-get install -y --no-install-recommends python3 python3-venv
fi
[ -x "$base/raytwin/bin/python" ] || python3 -m venv "$base/raytwin"
if [ -z "${RAYTWIN_NO_INSTALL:-}" ]; then
  "$base/raytwin/bin/python" -m pip install --quiet --no-cache-dir @REQUIRED@
fi
"""

RUN = """#!/usr/bin/env bash
# Run for each submission, as root.
set -uo pipefail
base="${RAYTWIN_AUTOGRADER:-/autograder}"
mkdir -p "$base/results"
# Submissions run as another user: neither references, rubric, results nor raytwin's own tracer are for them.
for closed in source results run_autograder raytwin/lib/python3*/site-packages/raytwin; do
  chmod -R o-rwx "$base"/$closed 2>/dev/null
done
export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
cd "$base/source"
exec "$base/raytwin/bin/python" -m raytwin grade "$base/submission" --rubric rubric.toml --whole \\
  -o "$base/results/.grades" --gradescope "$base/results/results.json"
"""


def write_zip(rubric_path: Path, out: Path, wheel: Path | None = None) -> list[str]:
    """Return the names inside. `wheel`: of raytwin, for a development version, which no package index has.

    Raises InputError where a scene of the rubric has no reference, and where a wheel is missing or none.
    """
    rubric = read_rubric(rubric_path)
    stored = {f"reference/{n}/{r}.exr": path for n, r, path in references_of(rubric, rubric_path)}
    if wheel is not None and (wheel.suffix != ".whl" or not wheel.is_file()):
        raise InputError("--wheel", "a wheel of raytwin (python -m build)", wheel)
    if wheel is None and "dev" in version("raytwin"):
        how = "Make a wheel of your clone (python -m pip wheel --no-deps CLONE) and pass it."
        raise InputError("--wheel:", f"This is version {version('raytwin')}, which no package index has. {how}")
    required = f'"$base/source/{wheel.name}"' if wheel else f'"raytwin=={version("raytwin")}"'
    required = " ".join([required, *(shlex.quote(name) for name in rubric.packages)])
    with replacing(out) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in (("setup.sh", SETUP.replace("@REQUIRED@", required)), ("run_autograder", RUN)):
            entry = zipfile.ZipInfo(name, (2000, 1, 1, 0, 0, 0))
            entry.external_attr = 0o100755 << 16
            archive.writestr(entry, text)
        archive.write(rubric_path, "rubric.toml")
        for name, path in (stored | ({wheel.name: wheel} if wheel else {})).items():
            archive.write(path, name)
        return archive.namelist()
