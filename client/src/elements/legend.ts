// The legend: a chip that unfolds upwards; the page remembers whether it is folded.
import { button, make, recall, remember } from "../dom.ts";
import { define, listen } from "../frame.ts";
import { padlock } from "../shared.ts";

const LOW_PX = 520; // Unfolded it would be under the tools.
const KEPT = "pd-legend-folded";
// Drawn, and listed, while it is asked what could happen.
const ARCS = [
  ["Could threaten it", "var(--pd-bad)"],
  ["Could yield", "var(--pd-guide)"],
].map(([text, color]) => ({ text, glyph: "line", color, keeps: "", isArc: true }));

define("legend", (api) => {
  const box = make("div", "pd-solid pd-legend-box");
  const list = make("ul", "pd-legend-list", { id: "pd-legend-list" });
  const chip = button("pd-legend-chip", "Legend", () => remember(KEPT, fold(!list.hidden)), {
    "aria-controls": "pd-legend-list",
  });
  box.append(list, chip);
  api.box.append(box);

  function fold(isFolded: boolean): boolean {
    list.hidden = isFolded;
    chip.setAttribute("aria-expanded", String(!isFolded));
    return isFolded;
  }
  fold((recall(KEPT) ?? innerHeight < LOW_PX) === true);
  let wasLow = innerHeight < LOW_PX;
  listen(window, "resize", () => {
    const isLow = innerHeight < LOW_PX;
    if (isLow !== wasLow) fold(isLow || recall(KEPT) === true);
    wasLow = isLow;
  });

  return ({ entries }) => {
    const lines = [...entries.map((entry) => ({ ...entry, isArc: false })), ...ARCS];
    list.replaceChildren(
      ...lines.map(({ text, glyph, color, keeps, isArc }) => {
        const item = make("li", isArc ? "pd-legend-arc" : "");
        const mark = make("span", `pd-legend-mark pd-legend-${glyph}`);
        mark.style.color = color;
        if (keeps) {
          mark.classList.add(`pd-lock-${keeps}`);
          mark.append(padlock());
        }
        item.append(mark, make("span", "", {}, text));
        return item;
      }),
    );
  };
});
