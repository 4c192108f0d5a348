"""Alerts, dashboard, runbook and the table of metrics name what there is, without Prometheus."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import yaml
from prometheus_client.metrics import MetricWrapperBase

from vibroimpact_service.jobs.metrics import JobMetrics
from vibroimpact_service.metrics import Metrics

ROOT = Path(__file__).parents[2]
MONITORING = ROOT / "docker" / "monitoring"
OPERATION = (ROOT / "docs" / "service" / "operation.md").read_text()
RUNBOOK = (ROOT / "docs" / "service" / "runbook.md").read_text()
ALERTS = yaml.safe_load((MONITORING / "alerts.yaml").read_text())["groups"][0]["rules"]
DASHBOARD = json.loads((MONITORING / "dashboard.json").read_text())
PANELS = [panel for panel in DASHBOARD["panels"] if panel["type"] != "row"]
QUERIES = [target["expr"] for panel in PANELS for target in panel["targets"]]
ROW = re.compile(r"^\| `(vibroimpact_\w+)` \| (\w+) \| (.+?) \| (.+?) \| (.+) \|$", re.M)
ENDINGS = {
    "counter": ("_total",),
    "gauge": ("",),
    "info": ("_info",),
    "histogram": ("_bucket", "_sum", "_count"),
}


def declared() -> list[MetricWrapperBase]:
    """Return all metrics of a service."""
    queue = JobMetrics()
    registries = queue.registry, Metrics(queue.registry)._registry
    collectors = [each for registry in registries for each in registry._collector_to_names]
    return [each for each in collectors if isinstance(each, MetricWrapperBase)]


def series() -> dict[str, set[str]]:
    """Return the names of all series, and the labels of each."""
    names = {}
    for metric in declared():
        for ending in ENDINGS[metric._type]:
            labels = {"version"} if metric._type == "info" else set(metric._labelnames)
            labels |= {"le"} if ending == "_bucket" else set()
            names[metric._name + ending] = labels
    return names


def test_alerts_and_dashboard_name_series_and_labels_that_there_are() -> None:
    known = series()
    for expression in (*(alert["expr"] for alert in ALERTS), *QUERIES):
        names = re.findall(r"\bvibroimpact_\w+", expression)
        assert names or re.search(r"\b(up|process_\w+)\{", expression), expression
        assert set(names) <= set(known), expression
        labels = {label for name in names for label in known[name]}
        named = re.findall(r"(\w+)(?:=~|!~|!=|=)\"", expression)
        for some in re.findall(r"\bby \(([^)]*)\)", expression):
            named += [label.strip() for label in some.split(",")]
        # Prometheus itself adds these.
        assert set(named) <= labels | {"instance", "job"}, expression


def test_every_metric_is_shown_or_watched() -> None:
    text = " ".join((*(alert["expr"] for alert in ALERTS), *QUERIES))
    missing = [metric._name for metric in declared() if metric._name not in text]
    assert missing == []


def test_the_table_of_metrics_is_that_of_the_service() -> None:
    rows = {name: rest for name, *rest in ROW.findall(OPERATION)}
    expected = {}
    for metric in declared():
        type_, name = metric._type, metric._name
        name += ENDINGS[type_][0] if type_ != "histogram" else ""
        labels = metric._labelnames or (("version",) if type_ == "info" else ())
        cell = ", ".join(f"`{label}`" for label in labels) or "–"
        expected[name] = ["gauge" if type_ == "info" else type_, cell, metric._documentation]
    assert {name: [type_, labels, about] for name, (type_, labels, _, about) in rows.items()} == (
        expected
    )
    assert {over for _, _, over, _ in rows.values()} == {"`max()`", "`sum()`", "each"}


def test_what_replicas_share_is_not_added_up() -> None:
    shared = {
        name
        for name, (_, _, over, _) in ((name, rest) for name, *rest in ROW.findall(OPERATION))
        if over == "`max()`"
    }
    assert "vibroimpact_jobs" in shared
    for expression in (*(alert["expr"] for alert in ALERTS), *QUERIES):
        for name in shared:
            added = rf"\bsum(?: by \([^)]*\))? \((?:rate\(|increase\()?{name}\b"
            assert not re.search(added, expression), expression


def test_each_alert_has_a_section_of_the_runbook_and_each_section_an_alert() -> None:
    sections = re.split(r"^## (\w+)\n", RUNBOOK, flags=re.M)[1:]
    texts = dict(zip(sections[::2], sections[1::2], strict=True))
    assert list(texts) == list(dict.fromkeys(texts))
    assert set(texts) == {alert["alert"] for alert in ALERTS}
    for alert in ALERTS:
        name = alert["alert"]
        place = f"docs/service/runbook.md#{name.lower()}"
        assert alert["annotations"]["runbook"] == place
        assert alert["annotations"]["summary"].endswith(".")
        assert alert["labels"]["severity"] in ("critical", "warning")
        assert "**Meaning.**" in texts[name]
        assert re.search(r"\*\*(Do\.|Likely causes, look at, do\.)\*\*", texts[name]), name
    for name in re.findall(r"vibroimpact_\w+", RUNBOOK):
        assert name in series(), name


def test_the_dashboard_is_one_that_grafana_imports() -> None:
    (variable,) = DASHBOARD["templating"]["list"]
    assert (variable["name"], variable["type"], variable["query"]) == (
        "datasource", "datasource", "prometheus",
    )  # fmt: skip
    assert "id" not in DASHBOARD  # Grafana gives one
    assert DASHBOARD["title"]
    assert DASHBOARD["schemaVersion"] >= 36
    ids = [panel["id"] for panel in DASHBOARD["panels"]]
    assert len(set(ids)) == len(ids)
    taken: set[tuple[int, int]] = set()
    for panel in DASHBOARD["panels"]:
        at = panel["gridPos"]
        assert at["x"] + at["w"] <= 24
        cells = {
            (x, y)
            for x in range(at["x"], at["x"] + at["w"])
            for y in range(at["y"], at["y"] + at["h"])
        }
        assert not cells & taken, panel["title"]
        taken |= cells
        assert panel["title"]
    of_variable: Any = {"type": "prometheus", "uid": "${datasource}"}
    for panel in PANELS:
        assert panel["datasource"] == of_variable
        assert panel["fieldConfig"]["defaults"]["unit"]
        references = [target["refId"] for target in panel["targets"]]
        assert len(set(references)) == len(references) > 0
        for target in panel["targets"]:
            assert target["datasource"] == of_variable
            assert re.findall(r"\[([^]]+)\]", target["expr"]) == ["$__rate_interval"] * (
                target["expr"].count("[")
            )
