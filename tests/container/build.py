"""Build docker/Dockerfile where there is no container engine, on a base made by debootstrap.

    python -m tests.container.build FOLDER

keeps images and the base in FOLDER, so that the next build needs only the second half. The base
stands for python:3.13-slim of a registry: that image, too, is Debian trixie with Python 3.13 as
`python` and `pip` in /usr/local.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
BASE = "localhost/python:3.13-slim"
IMAGE = "localhost/vibroimpact:tested"
CONTAINER = "tested"
"""Container of that image, whose file system the tests mount and nothing changes."""
ARCHITECTURES = {"x86_64": "amd64", "aarch64": "arm64"}
PROGRAMS = {
    "buildah": "buildah",
    "debootstrap": "debootstrap",
    "ip": "iproute2",
    "nsenter": "util-linux",
    "unshare": "util-linux",
}
"""Program -> Debian's package."""


def missing() -> str | None:
    """Say what this machine lacks, or nothing."""
    if os.geteuid() != 0:
        return "root: only root makes file systems and namespaces of containers"
    lacking = sorted({PROGRAMS[name] for name in PROGRAMS if shutil.which(name) is None})
    return f"programs: apt install {' '.join(lacking)}" if lacking else None


class Storage:
    """Images and containers of buildah in a folder of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self.folder.mkdir(parents=True, exist_ok=True)
        configuration = self.folder / "storage.conf"
        configuration.write_text(
            f'[storage]\ndriver = "vfs"\nrunroot = "{self.folder}/run"\n'
            f'graphroot = "{self.folder}/root"\n'
        )
        self._environment = {
            **os.environ,
            "CONTAINERS_STORAGE_CONF": str(configuration),
            "BUILDAH_ISOLATION": "chroot",
        }

    def run(self, *command: str) -> None:
        """Run a command of buildah, with its output to see."""
        subprocess.run(["buildah", *command], env=self._environment, check=True)

    def ask(self, *command: str) -> str:
        """Return what a command of buildah prints."""
        return subprocess.run(
            ["buildah", *command], env=self._environment, check=True, text=True, stdout=-1
        ).stdout.strip()

    def has(self, image: str) -> bool:
        """Whether an image is there."""
        command = ["buildah", "inspect", "--type", "image", image]
        return not subprocess.run(command, env=self._environment, capture_output=True).returncode

    def tree(self) -> Path:
        """Return the file system of the built image."""
        return Path(self.ask("mount", CONTAINER))

    def inspect(self, image: str) -> dict[str, Any]:
        """Return the configuration of an image: Env, Cmd, Entrypoint, User, Healthcheck, …"""
        inspected = json.loads(self.ask("inspect", "--type", "image", image))
        configuration: dict[str, Any] = inspected["Docker"]["config"]
        return configuration

    def make_base(self) -> None:
        """Make the base image: Debian and its Python."""
        container = self.ask("from", "scratch")
        tree = self.ask("mount", container)
        subprocess.run(
            ["debootstrap", "--variant=minbase", "--include=ca-certificates,python3,python3-venv",
             "trixie", tree, "http://deb.debian.org/debian"],
            check=True, stdout=sys.stderr,
        )  # fmt: skip
        subprocess.run(["chroot", tree, "python3", "-m", "venv", "/usr/local"], check=True)
        for part in ("var/cache/apt", "var/lib/apt/lists"):
            shutil.rmtree(Path(tree, part))
            Path(tree, part).mkdir()
        path = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
        self.run("config", "--env", f"PATH={path}", "--cmd", "python3", container)
        self.run("commit", "--format", "docker", "--rm", container, BASE)

    def build(self) -> None:
        """Build the Dockerfile, every step of it."""
        digest = self.ask("images", "--format", "{{.Digest}}", BASE)
        architecture = ARCHITECTURES[os.uname().machine]
        self.run(
            "bud", "--isolation", "chroot", "--format", "docker", "--no-cache",
            "--platform", f"linux/{architecture}",
            "--build-arg", f"PYTHON_IMAGE={BASE}@{digest}",
            # The authorities that this machine trusts, a company's own perhaps.
            "--volume", "/etc/ssl/certs:/etc/ssl/certs:ro",
            "-f", str(ROOT / "docker" / "Dockerfile"), "-t", IMAGE, str(ROOT),
        )  # fmt: skip
        if CONTAINER in self.ask("containers", "--format", "{{.ContainerName}}").split():
            self.run("rm", CONTAINER)
        self.run("from", "--name", CONTAINER, IMAGE)


def main() -> None:
    lacking = missing()
    if lacking is not None:
        sys.exit(f"The image cannot be built without {lacking} (see CONTRIBUTING.md)")
    storage = Storage(Path(sys.argv[1]))
    start = time.monotonic()
    if not storage.has(BASE):
        storage.make_base()
        print(f"base: {time.monotonic() - start:.0f} s")
    start = time.monotonic()
    storage.build()
    print(f"image: {time.monotonic() - start:.0f} s")


if __name__ == "__main__":
    main()
