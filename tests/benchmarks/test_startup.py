"""How long a user waits before anything happens: `import kinid`, and `kinid --help`."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time

import pytest

IMPORT = "import kinid"
HELP = "import sys; sys.argv = ['kinid', '--help']; from kinid.cli import main; main()"
#: what takes long to load, and is loaded where it is used
HEAVY = {"numpy", "scipy", "numba", "pinocchio", "pyarrow", "pydantic", "plotly", "meshcat", "casadi", "ruckig", "rich"}


def run(code: str) -> float:
    """Seconds of a fresh process."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begin


@pytest.mark.parametrize(("name", "code", "most"), [("import kinid", IMPORT, 0.3), ("kinid --help", HELP, 0.4)])
def test_seconds(benchmark, name: str, code: str, most: float) -> None:
    run(code)  # from the disk once
    benchmark.pedantic(run, args=(code,), rounds=1)
    if not benchmark.enabled:
        return
    times = [run(code) for _ in range(11)]
    nothing = [run("pass") for _ in range(11)]
    print(
        f"{name}: median {statistics.median(times):.3f} s, of which the interpreter itself "
        f"{statistics.median(nothing):.3f} s"
    )
    assert statistics.median(times) <= most


@pytest.mark.parametrize("code", [IMPORT, HELP], ids=["import", "help"])
def test_nothing_heavy_is_loaded(code: str) -> None:
    ask = f"import atexit, sys; atexit.register(lambda: print(*{HEAVY} & sys.modules.keys(), file=sys.stderr)); {code}"
    done = subprocess.run([sys.executable, "-c", ask], check=True, capture_output=True, text=True)
    assert done.stderr.split() == []


def test_a_refusal_loads_no_statistics() -> None:
    """What most commands have no use for takes longer to load than the refusal of a name to be found."""
    code = (
        "import sys; sys.argv = ['kinid', 'fit', 'absent.csv', '--model', 'hooke']; from kinid.cli import main; main()"
    )
    ask = f"import atexit, sys; atexit.register(lambda: print(*sys.modules)); {code}"
    done = subprocess.run([sys.executable, "-c", ask], check=False, capture_output=True, text=True)
    assert done.returncode == 2
    assert "no file absent.csv" in done.stderr
    assert not {"scipy.stats", "scipy.signal", "scipy.optimize"} & set(done.stdout.split())
