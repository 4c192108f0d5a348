// Formulas of the pages, which arithmatex leaves as \(...\) and \[...\], drawn by KaTeX.
for (const place of document.querySelectorAll(".arithmatex")) {
  const text = place.textContent.trim();
  katex.render(text.slice(2, -2), place, {
    displayMode: text.startsWith("\\["),
    throwOnError: false,
  });
}

// What scrolls can be reached by the keyboard.
const SCROLLING = ".arithmatex, .md-typeset__scrollwrap, .md-typeset p, .highlight code";
function reachable() {
  for (const place of document.querySelectorAll(SCROLLING)) {
    if (place.scrollWidth > place.clientWidth && getComputedStyle(place).overflowX !== "visible") {
      place.tabIndex = 0;
    }
  }
}
reachable();
addEventListener("resize", reachable);

// A name that the theme does not give.
document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
