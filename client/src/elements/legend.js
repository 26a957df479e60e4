// The legend: a chip that unfolds upwards; the page remembers whether it is folded.
pdOverlay.define("legend", (api) => {
  const KEPT = "pd-legend-folded";
  // Drawn, and listed, while it is asked what could happen.
  const ARCS = [["Could threaten it", "var(--pd-bad)"], ["Could yield", "var(--pd-guide)"]]
    .map(([text, color]) => ({ text, glyph: "line", color, isArc: true }));
  const box = api.make("div", "pd-solid pd-legend-box");
  const list = api.make("ul", "pd-legend-list", { id: "pd-legend-list" });
  const chip = api.make("button", "pd-legend-chip", {
    type: "button", "aria-controls": "pd-legend-list",
  }, "Legend");
  box.append(list, chip);
  api.box.append(box);

  function fold(isFolded) {
    list.hidden = isFolded;
    chip.setAttribute("aria-expanded", String(!isFolded));
  }

  let isFolded = api.recall(KEPT) === true;
  fold(isFolded);
  chip.addEventListener("click", () => {
    isFolded = !isFolded;
    api.remember(KEPT, isFolded);
    fold(isFolded);
  });

  return ({ entries }) => {
    list.replaceChildren(...[...entries, ...ARCS].map(({ text, glyph, color, keeps, isArc }) => {
      const item = api.make("li", isArc ? "pd-legend-arc" : "");
      const mark = api.make("span", `pd-legend-mark pd-legend-${glyph}`);
      mark.style.color = color;
      if (keeps) {
        mark.classList.add(`pd-lock-${keeps}`);
        mark.append(pdOverlay.padlock());
      }
      item.append(mark, api.make("span", "", {}, text));
      return item;
    }));
  };
});
