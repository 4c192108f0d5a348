"""The examples of docker/ agree with the commands, the settings, the routes and one another."""

from __future__ import annotations

import ast
import ipaddress
import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.main import get_command

from tests.container import sbom
from vibroimpact_service import cli
from vibroimpact_service.access.commands import app as keys
from vibroimpact_service.api import service as service_routes
from vibroimpact_service.jobs import certificates
from vibroimpact_service.settings import Settings

ROOT = Path(__file__).parents[2]
DOCKER = ROOT / "docker"
FILES = sorted(path for path in DOCKER.rglob("*") if path.is_file())
YAML = [path for path in FILES if path.suffix == ".yaml"]
KUBERNETES = sorted((DOCKER / "kubernetes").rglob("*.yaml"))
SERVICE = DOCKER / "kubernetes" / "base" / "service.yaml"
COMPOSE = [DOCKER / "compose.yaml", DOCKER / "cluster" / "compose.yaml"]
ARCHITECTURES = {"amd64": "x86_64", "arm64": "aarch64"}
"""Of an image -> of the compiler."""


def _documents(path: Path) -> list[Any]:
    return list(yaml.safe_load_all(path.read_text()))


def _literals(*overlays: str) -> dict[str, str]:
    """Return the configuration of the base and of overlays on it."""
    found: dict[str, str] = {}
    for name in ("base", *(f"overlays/{each}" for each in overlays)):
        (document,) = _documents(DOCKER / "kubernetes" / name / "kustomization.yaml")
        for generator in document["configMapGenerator"]:
            found |= dict(literal.split("=", 1) for literal in generator["literals"])
    return found


def _mappings(node: Any) -> Iterator[dict[str, Any]]:
    if isinstance(node, dict):
        yield node
    for part in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from _mappings(part)


def _commands(words: list[str]) -> Iterator[list[str]]:
    """Yield the commands of the service in an argument list or a line of shell."""
    if words[:1] == ["sh"]:
        words = shlex.split(words[-1])
    for place, word in enumerate(words):
        if word == "vibroimpact" and place + 1 < len(words):
            yield words[place + 1 :]


def _lines() -> Iterator[tuple[str, list[str]]]:
    """Yield where, and the arguments of, every command in the examples and their comments."""
    for path in FILES:
        joined = path.read_text().replace("\\\n#", " ").replace("\\\n", " ")
        for line in joined.splitlines():
            if line.strip().startswith(("command:", "args: [", "CMD [")):
                words = yaml.safe_load(line[line.index("[") :])
                yield from ((path.name, found) for found in _commands(words))
            else:
                pattern = r"\bvibroimpact (?=(?:serve|scheduler|worker|certificates|keys)\b)(.+)"
                for found in re.findall(pattern, line):
                    yield path.name, re.split(r"[`|;]", found)[0].split()


LINES = list(_lines())


def test_the_examples_hold_commands() -> None:
    names = {words[0] for _, words in LINES}
    assert names >= {"serve", "scheduler", "worker", "certificates", "keys"}


@pytest.mark.parametrize(("place", "words"), LINES, ids=[f"{p}: {w[0]}" for p, w in LINES])
def test_every_command_and_option_is_there(place: str, words: list[str]) -> None:
    command: Any = get_command(cli.app)
    if words[0] == "keys":
        command, words = get_command(keys), words[1:]
    command = command.commands[words[0]]
    options = {flag for option in command.params for flag in option.opts}
    given = [word for word in words[1:] if word.startswith("--")]
    assert [flag for flag in given if flag not in options] == []


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(DOCKER)))
def test_every_variable_is_a_setting(path: Path) -> None:
    known = {f"VIBROIMPACT_{name.upper()}" for name in Settings.model_fields}
    own = {"VIBROIMPACT_NAME", "VIBROIMPACT_TLS"}  # of the proxy and of the shell script
    found = set(re.findall(r"VIBROIMPACT_[A-Z_]*[A-Z]", path.read_text()))
    assert found - known - own == set()


@pytest.mark.parametrize("path", YAML, ids=lambda path: str(path.relative_to(DOCKER)))
def test_yaml_is_yaml(path: Path) -> None:
    assert all(isinstance(document, dict) for document in _documents(path))


def test_the_image_has_all_that_the_wheel_is_made_of() -> None:
    """What the build needs is copied, and not kept out by .dockerignore."""
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = build["tool"]["hatch"]["build"]["targets"]["wheel"]
    project = build["project"]
    needed = ["pyproject.toml", project["readme"], *project["license-files"]]
    needed += [*wheel["packages"], *wheel["force-include"]]
    text = (DOCKER / "Dockerfile").read_text()
    copied = [
        source
        for line in re.findall(r"^COPY (?!--from)(.+) \S+$", text, re.M)
        for source in line.split()
    ]
    rules = (ROOT / ".dockerignore").read_text().split()
    assert rules[0] == "*"
    let_in = [rule[1:] for rule in rules if rule.startswith("!")]
    for path in needed:
        parents = [path, *map(str, Path(path).parents)]
        assert any(parent in copied for parent in parents), path
        assert any(fnmatch(parent, rule) for parent in parents for rule in let_in), path


def test_the_image_installs_what_is_locked_by_hashes() -> None:
    text = (DOCKER / "Dockerfile").read_text().replace("\\\n", " ")
    installs = [line for line in re.split(r"\n|&&", text) if "pip install" in line]
    assert installs
    for line in installs:
        (name,) = re.findall(r"-r (\S+)", line) or ["/wheels/*.whl"]
        assert "--require-hashes" in line or (name == "/wheels/*.whl" and "--no-deps" in line)
        assert name.startswith("/wheels") or (ROOT / name).is_file()


@pytest.mark.parametrize("name", ["image", "build", "ci", "tools"])
def test_every_locked_version_has_hashes(name: str) -> None:
    text = (ROOT / "requirements" / f"{name}.txt").read_text().replace("\\\n", " ")
    entries = [line for line in text.splitlines() if line and not line.lstrip().startswith("#")]
    assert entries
    for entry in entries:
        assert re.match(r"[a-z0-9._-]+(\[[a-z,]+\])?==\S+", entry), entry
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", entry), entry


def test_what_the_image_needs_is_locked() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    text = (ROOT / "requirements" / "image.txt").read_text()
    locked = set(re.findall(r"^([a-z0-9._-]+)==", text, re.M))
    wanted, extras = list(project["dependencies"]), ["service", "client", "postgresql", "s3"]
    for extra in extras:
        for each in project["optional-dependencies"][extra]:
            inner = re.fullmatch(r"vibroimpact\[(.+)\]", each)
            if inner is None:
                wanted.append(each)
            else:
                extras += inner[1].split(",")
    names = {re.split(r"[\[<>=;]", each)[0].lower().replace("_", "-") for each in wanted}
    assert names
    assert names <= locked


def _component(name: str, version: str, hashes: list[str]) -> dict[str, Any]:
    """Return a package as cyclonedx-py lists it."""
    digests = [{"alg": "SHA-256", "content": each} for each in hashes]
    source = {"type": "distribution", "url": "https://pypi.org/simple/", "hashes": digests}
    return {"name": name, "version": version, "externalReferences": [source]}


def test_the_list_of_the_image_has_every_locked_package() -> None:
    """What compares them in `nox -s sbom`; the tool itself is installed by that session alone."""
    text = (ROOT / "requirements" / "image.txt").read_text()
    packages = sorted(sbom.locked(text), key=lambda package: package[:2])
    assert len(packages) == len(re.findall(r"^[a-z]", text, re.M))  # all other lines go on
    assert sum(len(hashes) for _, _, hashes in packages) == text.count("--hash=sha256:")
    components = [_component(name, version, sorted(each)) for name, version, each in packages]
    assert sbom.differences({"components": components}, text) == []
    assert sbom.differences({"components": components[1:]}, text) == [components[0]["name"]]
    for wrong in (
        components[0] | {"version": "0"},
        components[0] | {"externalReferences": []},
    ):
        found = sbom.differences({"components": [wrong, *components[1:]]}, text)
        assert found == [components[0]["name"]]
    more = _component("more", "1", [])
    assert sbom.differences({"components": [*components, more]}, text) == ["more"]


def test_all_that_the_image_installs_is_listed_and_audited() -> None:
    """What the index knows of vulnerabilities is asked by `nox -s audit` alone."""
    sessions = {
        node.name: ast.unparse(node)
        for node in ast.parse((ROOT / "noxfile.py").read_text()).body
        if isinstance(node, ast.FunctionDef)
    }
    installed = set(re.findall(r"-r requirements/(\w+)\.txt", (DOCKER / "Dockerfile").read_text()))
    (audited,) = re.findall(r"for name in \((.+)\):", sessions["audit"])
    assert installed <= set(re.findall(r"\w+", audited))
    assert "'--strict'" in sessions["audit"]
    assert "'requirements/image.txt'" in sessions["sbom"]  # the rest builds it, and is not in it
    assert "'tests.container.sbom'" in sessions["sbom"]


def test_the_image_says_what_it_is() -> None:
    """By the names of the OCI; addresses follow when the project has one."""
    text = (DOCKER / "Dockerfile").read_text().replace("\\\n", " ")
    (labels,) = re.findall(r"^LABEL (.+)$", text, re.M)
    given = dict(re.findall(r'org\.opencontainers\.image\.([a-z.]+)="([^"]*)"', labels))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert set(given) == {
        *("title", "description", "licenses", "version", "revision", "base.name")
    }  # fmt: skip
    assert given["licenses"] == project["license"]
    assert (given["version"], given["base.name"]) == ("${VERSION}", "${PYTHON_IMAGE}")
    last = text[text.rindex("\nFROM ") :]
    assert f"\nARG VERSION={project['version']}\n" in last
    assert "\nARG PYTHON_IMAGE\n" in last  # it is known in the stages that ask for it


def test_the_service_alone_is_built_and_started_where_nothing_is_set() -> None:
    """Its image has a base by default, and it starts before the first key is made."""
    (found,) = _documents(DOCKER / "compose.yaml")
    (service,) = found["services"].values()
    (default,) = re.findall(r"\$\{PYTHON_IMAGE:-(.+)\}", service["build"]["args"]["PYTHON_IMAGE"])
    assert f"\nARG PYTHON_IMAGE={default}\n" in (DOCKER / "Dockerfile").read_text()
    assert service["environment"]["VIBROIMPACT_ACCESS"] == "${ACCESS:-keys}"
    text = (DOCKER / "compose.yaml").read_text()
    assert not re.findall(r"\$\{[A-Z_]+:\?", text)  # what would have to be set


def test_images_of_a_cluster_are_named_by_digest() -> None:
    text = (DOCKER / "Dockerfile").read_text()
    given = re.findall(r"^FROM (\S+)(?: AS (\S+))?", text, re.M)
    stages = {name for _, name in given} - {""}
    architectures = {f"base-{architecture}" for architecture in ARCHITECTURES}
    assert architectures <= stages
    assert {image for image, _ in given} == {"${PYTHON_IMAGE}", "base-${TARGETARCH}"}
    for path in COMPOSE:
        (found,) = _documents(path)
        for service in found["services"].values():
            image = service.get("image", "vibroimpact")
            assert image == "vibroimpact" or re.fullmatch(r"\$\{[A-Z_]+:\?.+@sha256:…\}", image)


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_kernels_are_compiled_for_processors_that_the_compiler_knows(architecture: str) -> None:
    """It warns of names that it does not know, and ignores them."""
    text = (DOCKER / "Dockerfile").read_text().replace("\\\n", " ")
    (stage,) = re.findall(rf"AS base-{architecture}\nENV (.+)", text)
    given = dict(each.split("=", 1) for each in stage.split())
    assert given.keys() == {"NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"}
    code = (
        "import sys; from llvmlite import binding as llvm; llvm.initialize_all_targets()\n"
        "llvm.initialize_all_asmprinters()\n"
        "triple, name, features = sys.argv[1:]\n"
        "target = llvm.Target.from_triple(triple)\n"
        "machine = target.create_target_machine(cpu=name, features=features)\n"
        "machine.emit_object(llvm.parse_assembly('define void @f() { ret void }'))\n"
    )
    command = [sys.executable, "-c", code, f"{ARCHITECTURES[architecture]}-unknown-linux-gnu"]

    def said(name: str, features: str) -> str:
        words = [*command, name, features]
        return subprocess.run(words, capture_output=True, text=True, check=False).stderr

    name, features = given.values()
    assert said(name, features) == ""
    assert "not a recognized processor" in said("neither", features)
    assert "not a recognized feature" in said(name, f"{features},+neither")


def test_the_build_file_names_the_architectures_and_the_version() -> None:
    text = (DOCKER / "bake.hcl").read_text()
    (platforms,) = re.findall(r"platforms = (\[.+\])", text)
    assert yaml.safe_load(platforms) == [f"linux/{each}" for each in ARCHITECTURES]
    (version,) = re.findall(r'variable "VERSION" {\s*default = "(.+)"', text)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert version == project["version"]
    (file,) = re.findall(r'dockerfile = "(.+)"', text)
    assert (ROOT / file).is_file()
    arguments = re.findall(r"^    ([A-Z_]+) = \1$", text, re.M)
    assert arguments == ["PYTHON_IMAGE", "VERSION", "REVISION"]
    (base,) = re.findall(r'variable "PYTHON_IMAGE" {\s*default = "(.+)"', text)
    assert f"ARG PYTHON_IMAGE={base}\n" in (DOCKER / "Dockerfile").read_text()
    released = (ROOT / ".github" / "workflows" / "release.yml").read_text()
    assert f"image={base}@$digest" in released  # what is published is built on a digest


@pytest.mark.parametrize("path", COMPOSE, ids=lambda path: path.parent.name)
def test_containers_are_closed_and_limited(path: Path) -> None:
    (document,) = _documents(path)
    for name, service in document["services"].items():
        assert service["read_only"] is True, name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert {"memory", "pids"} <= set(service["deploy"]["resources"]["limits"]), name
        if service["image"] == "vibroimpact":
            assert "cap_add" not in service, name
            environment = service.get("environment", {})
            cores = service["deploy"]["resources"]["limits"].get("cpus")
            assert cores is None or cores == environment["PYTHON_CPU_COUNT"], name


def test_only_the_service_has_the_database() -> None:
    (document,) = _documents(COMPOSE[1])
    has = {
        name
        for name, service in document["services"].items()
        if "VIBROIMPACT_DATABASE" in service.get("environment", {})
    }
    assert has == {"service"}


def test_probes_ask_routes_and_ports_that_are_there() -> None:
    routes = {getattr(route, "path", None) for route in service_routes.router.routes}
    asked = 0
    for path in KUBERNETES:
        for container in _mappings(_documents(path)):
            ports = {port.get("name") for port in container.get("ports", ()) if "name" in port}
            for name in ("startupProbe", "livenessProbe", "readinessProbe"):
                probe = container.get(name, {})
                if "httpGet" in probe:
                    assert probe["httpGet"]["path"] in routes
                    assert probe["httpGet"]["port"] in ports
                    asked += 1
    assert asked == 3
    assert "/v1/health/live" in (DOCKER / "Dockerfile").read_text()


@pytest.mark.parametrize("overlay", ["embedded", "cluster"])
def test_kubernetes_names_what_it_has(overlay: str) -> None:
    """Services select pods that there are; secrets and files have their names in the comments."""
    folders = [DOCKER / "kubernetes" / name for name in ("base", f"overlays/{overlay}")]
    objects, patches = [], []
    for folder in folders:
        (kustomization,) = _documents(folder / "kustomization.yaml")
        assert kustomization["namespace"] == "vibroimpact"
        named = [each for each in kustomization["resources"] if each != "../../base"]
        patching = [each["path"] for each in kustomization.get("patches", ())]
        there = {path.name for path in folder.glob("*.yaml")} - {"kustomization.yaml"}
        assert {*named, *patching} == there
        objects += [found for name in named for found in _documents(folder / name)]
        patches += [found for name in patching for found in _documents(folder / name)]
    pods = [
        one["spec"]["template"]["metadata"]["labels"]
        for one in objects
        if one["kind"] == "Deployment"
    ]
    for one in objects:
        if one["kind"] == "Service":
            selector = one["spec"]["selector"].items()
            assert any(selector <= labels.items() for labels in pods)
    for patch in patches:
        names = [one["metadata"]["name"] for one in objects if one["kind"] == patch["kind"]]
        assert patch["metadata"]["name"] in names
    text = (folders[-1] / "kustomization.yaml").read_text()
    secrets = set(re.findall(r"secret generic (\S+)", text))
    used = {
        node[key][name]
        for node in _mappings([*objects, *patches])
        for key, name in (("secretRef", "name"), ("secret", "secretName"))
        if key in node
    }
    assert used == secrets
    literals = _literals(overlay)
    names = [f"VIBROIMPACT_TLS_{name}" for name in ("CA", "CERT", "KEY")]
    files = {Path(literals.get(name, "")).name for name in names}
    assert files == ({"ca.pem", "cert.pem", "key.pem"} if overlay == "cluster" else {""})


def test_workers_are_scaled_by_a_metric_that_there_is() -> None:
    (scaler, *_) = _documents(DOCKER / "kubernetes" / "overlays" / "cluster" / "scaling.yaml")
    (external, _) = scaler["spec"]["metrics"]
    name = external["external"]["metric"]["name"]
    (adapter,) = _documents(DOCKER / "monitoring" / "adapter.yaml")
    (rule,) = adapter["rules"]["external"]
    assert rule["name"]["as"] == name
    served = (ROOT / "docs" / "service" / "operation.md").read_text()
    for metric in re.findall(r"vibroimpact_\w+", f"{rule['seriesQuery']} {rule['metricsQuery']}"):
        assert f"| `{metric}` |" in served  # the table that test_monitoring compares


def test_certificates_have_the_names_that_the_examples_use(tmp_path: Path) -> None:
    names = [path.name for path in certificates.write(tmp_path, 1)]
    assert names == ["ca.pem", "cert.pem", "key.pem"]


def test_compose_depends_on_what_there_is() -> None:
    for path in COMPOSE:
        (found,) = _documents(path)
        for service in found["services"].values():
            assert set(service.get("depends_on", ())) <= set(found["services"])
            for volume in service.get("volumes", ()):
                source = volume.partition(":")[0]
                assert source in found["volumes"] or (path.parent / source).is_file()
            build = service.get("build")
            if build is not None:
                assert (path.parent / build["context"]).resolve() == ROOT
                assert (ROOT / build["dockerfile"]).is_file()


def test_forwarded_addresses_are_believed_of_the_proxy_alone() -> None:
    given = {}
    for path in FILES:
        for value in re.findall(r"FORWARDED_ALLOW_IPS[=:] *(\S+)", path.read_text()):
            given[path.parent.name] = [ipaddress.ip_address(each) for each in value.split(",")]
    assert given.keys() == {"cluster", "base"}
    (cluster,) = _documents(DOCKER / "cluster" / "compose.yaml")
    proxy = cluster["services"]["proxy"]["networks"]["default"]["ipv4_address"]
    assert [str(each) for each in given["cluster"]] == [proxy]
    (network,) = cluster["networks"]["default"]["ipam"]["config"]
    fixed = ipaddress.ip_address(proxy)
    assert fixed in ipaddress.ip_network(network["subnet"])
    assert fixed not in ipaddress.ip_network(network["ip_range"])  # else another could get it


def test_scripts_are_read_by_the_shell() -> None:
    (script,) = (path for path in FILES if path.suffix == ".sbatch")
    subprocess.run(["bash", "-n", str(script)], check=True)


def test_the_batch_script_starts_workers_as_slurm_says(tmp_path: Path) -> None:
    """Runs the script with a double of srun, which writes what it is told."""
    srun = tmp_path / "srun"
    srun.write_text('#!/bin/sh\necho "$@"\n')
    srun.chmod(0o755)
    script = str(DOCKER / "slurm" / "workers.sbatch")
    environment = {
        **os.environ,
        "PATH": f"{tmp_path}:{os.environ['PATH']}",
        "SLURM_CPUS_PER_TASK": "12",
        "VIBROIMPACT_STORE": "/scratch/store",
    }
    command = ["bash", script, "tls://head:8786"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "vibroimpact worker tls://head:8786 --tls tls --workers 12\n"
    del environment["VIBROIMPACT_STORE"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "the store of the services" in done.stderr


def test_prometheus_reads_the_port_that_needs_no_key() -> None:
    """The example's scrape, annotations and policies name the port of the metrics."""
    (compose,) = _documents(DOCKER / "cluster" / "compose.yaml")
    environment = compose["services"]["service"]["environment"]
    assert environment["VIBROIMPACT_ACCESS"] == "keys"
    (prometheus,) = _documents(DOCKER / "monitoring" / "prometheus.yaml")
    (job,) = prometheus["scrape_configs"]
    (targets,) = job["dns_sd_configs"]
    assert targets["names"] == ["service"]
    assert targets["port"] == environment["VIBROIMPACT_METRICS_PORT"]
    assert all((DOCKER / "monitoring" / name).is_file() for name in prometheus["rule_files"])

    pod = _documents(SERVICE)[0]["spec"]["template"]
    (container,) = pod["spec"]["containers"]
    given = _literals()
    assert given["VIBROIMPACT_ACCESS"] == "keys"
    ports = {port["name"]: port["containerPort"] for port in container["ports"]}
    assert str(ports["metrics"]) == given["VIBROIMPACT_METRICS_PORT"]
    assert pod["metadata"]["annotations"]["prometheus.io/port"] == str(ports["metrics"])
    # Who reaches it: test_network_policies.
