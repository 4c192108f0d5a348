"""The files of the console, as they are sent."""

from __future__ import annotations

from vibroimpact_service import console

_MODULE = b"""// What it is.

import { make } from "./dom.js"; // kept: it is no line of its own

/**
 * A function.
 * @param {string} url
 */
export function link(url) {
  // A line.
  return /** @type {HTMLElement} */ (make("a", { href: `https://${url}` }));
}
"""


def test_comments_are_not_sent_and_lines_keep_their_numbers() -> None:
    sent = console.without_comments(_MODULE)
    assert sent.count(b"\n") == _MODULE.count(b"\n")
    assert sent.splitlines()[10].strip() == b'return  (make("a", { href: `https://${url}` }));'
    for word in (b"What it is", b"@param", b"@type", b"A line"):
        assert word not in sent
    assert b"// kept" in sent


def test_every_module_is_sent_so_and_the_licence_of_others_stays() -> None:
    own = {n: c for n, c in console.FILES.items() if n.endswith(".js") and "/" not in n}
    assert len(own) > 30
    assert not [name for name, content in own.items() if b"@param" in content]
    assert console.FILES["vendor/uPlot.js"].startswith(b"/*! https://github.com/leeoniya/uPlot")
