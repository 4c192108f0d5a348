"""Compare the list of what the image holds (CycloneDX) with the versions and hashes in a lock file.

    python -m tests.container.sbom sbom.json requirements/image.txt

ends with an error where they are not the same.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

Package = tuple[str, str, frozenset[str]]
"""Name, version and the SHA-256 of its files; systems may have other versions than others."""


def locked(text: str) -> set[Package]:
    """Return what a lock file names."""
    found = re.findall(r"^([a-z0-9._-]+)(?:\[.+?\])?==(\S+)(.*)$", text.replace("\\\n", " "), re.M)
    return {
        (name, version, frozenset(re.findall(r"--hash=sha256:([0-9a-f]{64})", rest)))
        for name, version, rest in found
    }


def listed(document: dict[str, Any]) -> set[Package]:
    """Return what a list of components names."""
    return {
        (
            each["name"],
            each["version"],
            frozenset(
                digest["content"]
                for source in each.get("externalReferences", ())
                for digest in source.get("hashes", ())
                if digest["alg"] == "SHA-256"
            ),
        )
        for each in document["components"]
    }


def differences(document: dict[str, Any], lock: str) -> list[str]:
    """Return the packages of which the list says something else than the lock file, or nothing."""
    return sorted({name for name, _, _ in listed(document) ^ locked(lock)})


def main(sbom: str, lock: str) -> None:
    """Compare two files."""
    text = Path(lock).read_text()
    if wrong := differences(json.loads(Path(sbom).read_text()), text):
        sys.exit(f"{sbom} and {lock} differ: {', '.join(wrong)}")
    print(f"{sbom} has the versions and hashes of all {len(locked(text))} packages")


if __name__ == "__main__":
    main(*sys.argv[1:])
