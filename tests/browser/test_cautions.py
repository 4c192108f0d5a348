"""What the pages say against themselves: what is neglected, what is neutral, what is outdated."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.browser.visits import LONG, Visit

STOP = {"dof": 0, "lower": 1, "upper": 1}
LOSSY = {"form": "oscillator", "damping": 0.1, "stops": [{**STOP, "restitution": 0.7}]}
ELASTIC = {"form": "oscillator", "damping": 0, "stops": [{**STOP, "restitution": 1}]}
DAMPING = "The damping C is neglected"
RESTITUTION = "The restitution of constraint 0 is taken as 1"


def _done(page: Page) -> None:
    """Wait until the view has its answer."""
    expect(page.locator(".readout").first).to_have_text(re.compile(r"\d"))


@pytest.mark.parametrize(
    ("view", "fields", "said"),
    [
        ("modes", {}, [DAMPING, RESTITUTION]),
        ("map", {"rows": 5, "points": 20}, [DAMPING, RESTITUTION]),
        ("driven", {"points": 30}, []),
        ("history", {"duration": 10}, []),
        ("history", {"duration": 10, "soft": True}, [RESTITUTION]),
        ("basins", {"cells": 5, "t_end": 5}, []),
    ],
)
def test_every_view_says_what_it_neglects(
    console: Visit, view: str, fields: dict[str, Any], said: list[str]
) -> None:
    page = console.open(view, LOSSY, **fields)
    _done(page)
    cautions = page.locator(".cautions .caution")
    expect(cautions).to_have_count(len(said))
    for caution, text in zip(cautions.all(), said, strict=True):
        expect(caution).to_contain_text(text)
        amber = "element => getComputedStyle(element).borderLeftColor"
        assert caution.evaluate(amber) == "rgb(178, 106, 0)"


def test_nothing_is_said_of_a_structure_without_losses(console: Visit) -> None:
    page = console.open("modes", ELASTIC)
    _done(page)
    expect(page.locator(".cautions .caution")).to_have_count(0)


def _strokes(console: Visit) -> None:
    """Note the colours of what canvases draw, with their dashes."""
    console.page.add_init_script(
        """const { stroke, fillRect, setLineDash } = CanvasRenderingContext2D.prototype;
        window.drawn = new Set();
        const proto = CanvasRenderingContext2D.prototype;
        proto.setLineDash = function (parts) {
          this.parts = parts.join(); return setLineDash.call(this, parts); };
        proto.stroke = function (...path) {
          window.drawn.add(`${this.strokeStyle} ${this.parts || ""}`);
          return stroke.apply(this, path); };
        proto.fillRect = function (...box) {
          window.drawn.add(`${this.fillStyle} filled`); return fillRect.apply(this, box); };"""
    )


def _colour(page: Page, name: str) -> str:
    of = "name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim()"
    return str(page.evaluate(of, name))


def test_undamped_motions_without_impacts_are_neutral(console: Visit) -> None:
    """Their multipliers are exp(+-2 pi i / Omega), of modulus 1."""
    _strokes(console)
    page = console.open("driven", ELASTIC, **{"from": 0.4, "to": 0.6, "points": 30}, Omega=0.5)
    expect(page.locator(".verdict")).to_contain_text("Neutral")
    expect(page.locator(".verdict")).not_to_contain_text("nearby motions leave it.")
    expect(page.locator(".legend").first).to_contain_text("neutral")
    drawn = page.evaluate("[...window.drawn]")
    # The line of motions without impacts has the ink of its own, and the dashes of neutral ones.
    assert f"{_colour(page, 'ink')} 10,3,2,3" in drawn
    assert f"{_colour(page, 'ink')} 6,4" not in drawn


def test_damped_motions_are_stable(console: Visit) -> None:
    page = console.open("driven", LOSSY, **{"from": 0.4, "to": 0.6, "points": 30}, Omega=0.5)
    expect(page.locator(".verdict")).to_contain_text("Stable: nearby motions settle on it.")


def test_impact_modes_that_do_not_lose_deviations_are_neutral(console: Visit) -> None:
    """Far above the spectrum of a chain they are, near grazing they are unstable."""
    _strokes(console)
    page = console.open("modes", {"form": "chain"}, Omega=4.0, **{"from": 1.9, "to": 4.2})
    stability = page.locator(".values dt:text-is('stability') + dd")
    expect(stability).to_have_text("neutral: deviations neither grow nor decay")
    expect(page.locator(".legend").first).to_contain_text("neutral")
    # The bands, with the strip of stability, come after the mode at the cursor.
    filled = f"{_colour(page, 'neutral')} filled"
    page.wait_for_function("colour => window.drawn.has(colour)", arg=filled, timeout=LONG)
    drawn = page.evaluate("[...window.drawn]")
    assert f"{_colour(page, 'unstable')} filled" in drawn
    assert f"{_colour(page, 'stable')} filled" not in drawn
    page.get_by_label("Ω of the cursor", exact=True).fill("2.1")
    expect(stability).to_contain_text("unstable: deviations grow")


def test_lines_of_branches_change_at_their_special_points(console: Visit) -> None:
    """As those of `Result.plot` do: stable, behind the flip unstable, behind the end a phantom."""
    page = console.open("jobs", LOSSY)
    drawn = page.evaluate(
        """async () => {
          const main = document.querySelector("script[type=module]").src;
          const { lines } = await import(new URL("branch_curves.js", main));
          const at = (Omega) => ({ Omega, height: 10 * Omega });
          const motion = (Omega, stability, exists) =>
            ({ ...at(Omega), stability, exists, neutral: false });
          const motions = [
            motion(0, 0.5, true), motion(1, 0.9, true),
            motion(2, 1.2, false), motion(3, 1.5, false),
          ];
          const point = (kind, Omega) => ({ ...at(Omega), kind, exists: true, segment: 1 });
          const special = [point("flip", 1.25), point("end", 1.75)];
          const plain = (paths) =>
            paths.map(({ colour, points }) => [colour, points.map(([x]) => x)]);
          return [plain(lines(motions, special)), plain(lines(motions, []))];
        }"""
    )
    assert drawn[0] == [
        ["stable", [0, 1, 1.25]], ["unstable", [1.25, 1.75]], ["phantom", [1.75, 2, 3]],
    ]  # fmt: skip
    assert drawn[1] == [["stable", [0, 1, 1.5]], ["phantom", [1.5, 2, 3]]]


FORMER = "the answer to the former input"


def test_a_refused_input_leaves_the_former_answer_as_such(console: Visit) -> None:
    page = console.open("modes", ELASTIC)
    _done(page)
    note = page.get_by_text(FORMER)
    expect(note).to_have_count(0)
    opaque = "element => getComputedStyle(element).opacity"
    figure = page.locator(".figure").first
    assert figure.evaluate(opaque) == "1"
    page.get_by_label("Ω from").fill("50")  # above the end of the range: the service refuses it
    expect(note).to_contain_text("the present one was refused")
    assert float(figure.evaluate(opaque)) < 0.6
    assert float(page.locator(".verdict").evaluate(opaque)) < 0.6
    page.get_by_label("Ω from").fill("1.2")
    expect(note).to_have_count(0)
    assert figure.evaluate(opaque) == "1"


@pytest.mark.parametrize(("view", "kind"), [("modes", "existence-bands"), ("driven", "branches")])
def test_a_refusal_of_what_comes_after_the_answer_does_not_make_it_a_former_one(
    console: Visit, view: str, kind: str
) -> None:
    problem = {"status": 422, "title": "Unprocessable", "detail": "no such luck", "errors": []}
    refuse = {
        "status": 422, "body": json.dumps(problem), "content_type": "application/problem+json",
    }  # fmt: skip
    console.page.route(f"**/v1/plan/{kind}", lambda route: route.fulfill(**refuse))
    page = console.open(view, LOSSY, points=30)
    _done(page)
    expect(page.locator("#message")).to_contain_text("no such luck")
    page.get_by_label("Ω from").fill("0.9")  # an answer to an input before the present one
    expect(page.locator("#message")).to_contain_text("no such luck")
    expect(page.get_by_text(FORMER)).to_have_count(0)
    assert page.locator(".figure").first.evaluate("it => getComputedStyle(it).opacity") == "1"


@pytest.mark.parametrize("view", ["modes", "driven", "map"])
def test_so_does_one_that_is_no_number(console: Visit, view: str) -> None:
    page = console.open(view, LOSSY, points=40, **({"rows": 5} if view == "map" else {}))
    _done(page)
    # The figure names its special points, too.
    name = "columns" if view == "map" else "points"
    field = page.get_by_role("spinbutton", name=name, exact=True)
    field.fill("1")
    note = page.get_by_text(FORMER)
    expect(note).to_contain_text("a field has no valid value")
    expect(field).to_have_attribute("aria-invalid", "true")
    # Another field does not make up for it.
    page.get_by_label("Ω from").fill("0.9")
    expect(note).to_contain_text("a field has no valid value")
    field.fill("50")
    expect(note).to_have_count(0)
    expect(field).not_to_have_attribute("aria-invalid", "true")


def test_so_does_one_of_the_structure(console: Visit) -> None:
    page = console.open("history", ELASTIC, duration=10)
    _done(page)
    restitution = page.get_by_role("group", name="Stop 0").get_by_label("Restitution", exact=True)
    restitution.fill("1.5")
    expect(page.get_by_text(FORMER)).to_be_visible()
    restitution.fill("0.5")
    expect(page.get_by_text(FORMER)).to_have_count(0)


INTERCHANGED = {"M": [[2, -1, 0], [-1, 2, -1], [0, -1, 2]], "K": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}
INDEFINITE = {"M": [[1, 0], [0, 1]], "K": [[1, 2], [2, 1]]}
FULL = {"M": [[1, 0], [0, 1]], "K": [[2, -1], [-1, 2]], "C": [[9, 0], [0, 9]]}


@pytest.mark.parametrize(
    ("structure", "said"),
    [
        ({"form": "matrices", "matrices": INTERCHANGED}, "M and K may be interchanged"),
        ({"form": "matrices", "matrices": INDEFINITE}, "K is indefinite"),
        ({"form": "matrices", "matrices": FULL}, "do not oscillate"),
        ({"form": "oscillator", "damping": 2}, "The damping ratio is 200 % of the critical one"),
    ],
)
def test_what_is_seldom_meant_is_said_beside_the_answer(
    console: Visit, structure: dict[str, Any], said: str
) -> None:
    page = console.open("history", structure, dof=0, v=1, duration=10)
    _done(page)
    expect(page.locator(".cautions")).to_contain_text(said)
    page = console.open("history", ELASTIC, duration=11)
    _done(page)
    expect(page.locator(".cautions .caution")).to_have_count(0)
