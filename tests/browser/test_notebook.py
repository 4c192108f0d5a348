"""The drawing in notebooks: the module that widgets get runs alone, as one file."""

from __future__ import annotations

import json
from typing import Any

from playwright.sync_api import Browser

from tests.browser.visits import LONG
from vibroimpact import notebook

SCENE: dict[str, Any] = {
    "geometry": {
        "layout": "profile",
        "n": 3,
        "drawn": [0, 1, 2],
        "fixed": [True, True],
        "springs": True,
        "smooth": False,
    },
    "stops": [{"dof": 1, "relativeTo": None, "lower": 0.2, "upper": 0.2}],
    "motions": [{"title": "one", "rows": [[0, -0.2, 0], [0.1, 0.2, 0.1]], "mirrored": True}],
    "again": True,
    "seconds": 1.0,
}


def test_the_widget_moves(browser: Browser) -> None:
    page = browser.new_page()
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.set_content("<main id='cell'></main>")
    program = notebook.module().replace("export default {", "const widget = {")
    start = f"widget.render({{model: {{get: () => ({json.dumps(SCENE)})}}, el: cell}});"
    page.add_script_tag(type="module", content=f"{program}\n{start}")
    canvas = page.locator("canvas")
    canvas.wait_for(timeout=LONG)
    before = canvas.evaluate("canvas => canvas.toDataURL()")
    page.wait_for_timeout(300)
    assert canvas.evaluate("canvas => canvas.toDataURL()") != before
    page.get_by_role("button", name="Pause").click()
    page.get_by_label("Time").fill("0.25")
    still = canvas.evaluate("canvas => canvas.toDataURL()")
    page.wait_for_timeout(200)
    assert canvas.evaluate("canvas => canvas.toDataURL()") == still
    assert wrong == []
    page.close()
