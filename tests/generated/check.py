"""Generate clients from the contract by the tools that others use, by default, and use them.

``python -m tests.generated.check FOLDER`` needs openapi-python-client, and npx.
"""

from __future__ import annotations

import importlib
import pkgutil
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
CONTRACT = ROOT / "openapi" / "openapi.json"
BINARY = {"application/x-matrix-market", "application/x-npy"}
"""Bodies beside JSON, which the generator for Python cannot send."""


def python(folder: Path) -> None:
    """Generate a client in Python, import all of it, and make a request document by it."""
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--meta", "none"]
    made = subprocess.run(
        [*command, "--path", str(CONTRACT), "--output-path", str(folder / "made"), "--overwrite"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    said = made.stdout + made.stderr
    assert set(re.findall(r"Unsupported content type (\S+)", said)) == BINARY, said
    assert "Unable" not in said, said
    assert "removal" not in said, said
    sys.path.insert(0, str(folder))
    package = importlib.import_module("made")
    names = [each.name for each in pkgutil.walk_packages(package.__path__, "made.")]
    for name in names:
        importlib.import_module(name)
    models: Any = importlib.import_module("made.models")
    request = {
        "system": {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]},
        "frequency": {"start": 1.0, "stop": 2.0, "num": 5},
    }
    assert models.ImpactModesRequest.from_dict(request).to_dict() == request
    print(f"Python: {len(names)} modules")


def typescript(folder: Path) -> None:
    """Generate types, and have the compiler read what a user writes by them."""
    shutil.copy(ROOT / "tests" / "generated" / "use.ts", folder)
    npx = ["npx", "--yes"]
    subprocess.run(
        [*npx, "openapi-typescript@7", str(CONTRACT), "-o", "api.ts"], cwd=folder, check=True
    )
    compiler = [
        *npx,
        "--package",
        "typescript@5.9.3",
        "tsc",
        "--noEmit",
        "--strict",
        "--skipLibCheck",
    ]
    subprocess.run([*compiler, "use.ts", "api.ts"], cwd=folder, check=True)
    print("TypeScript: compiled")


if __name__ == "__main__":
    place = Path(sys.argv[1])
    place.mkdir(parents=True, exist_ok=True)
    python(place)
    typescript(place)
