"""Runs command lines whose files may not grow beyond a size, as on a full disk, and tells how each ended."""

from __future__ import annotations

import contextlib
import io
import json
import resource
import sys
from pathlib import Path

from kinid.cli import main

for line, limit in json.loads(sys.argv[1]):
    before = {str(path) for path in Path().rglob("*") if path.is_file()}
    said, sys.argv = io.StringIO(), ["kinid", *line.split()]
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            main()
    except SystemExit as end:
        code = end.code
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    left = {str(path) for path in Path().rglob("*") if path.is_file()} - before
    print(json.dumps([line, limit, code, said.getvalue(), sorted(left)]), flush=True)
