// Hints for a first session: one at a time, each gone for good once it was followed.
import { button, make, recall, remember } from "../dom.ts";
import { define } from "../frame.ts";

const KEPT = "pd-hints-done";
const STEPS = [
  ["select", "Click a car", "to select it; Ctrl+drag selects several."],
  ["drag", "Drag it", "to move it; Shift+drag turns it."],
  ["bend", "Bend the road", "by hand (W), or in the tab Road."],
  ["regenerate", "Regenerate", "trajectories with the key R, or in the tab Generate."],
];
const FILL = ["", "Fill the road", "with the button at the bottom."];

define("hints", (api) => {
  const kept = recall(KEPT);
  const done = new Set<unknown>(Array.isArray(kept) ? kept : []);
  const card = make("div", "pd-solid pd-hint", { role: "status", "aria-label": "Hint" });
  const count = make("span", "pd-hint-count");
  const what = make("b");
  const how = make("span");
  const label = "Close the hints";
  const close = () => finish(STEPS.map(([name]) => name));
  card.append(count, what, how, button("", "\u00d7", close, { "aria-label": label, title: label }));
  card.hidden = true;
  let isEmpty = false;
  api.box.append(card);

  function finish(names: readonly string[]) {
    for (const name of names) done.add(name);
    remember(KEPT, [...done]);
    const index = STEPS.findIndex(([name]) => !done.has(name));
    card.hidden = index < 0;
    if (index < 0) return;
    count.textContent = isEmpty ? "" : `${index + 1} / ${STEPS.length}`;
    [, what.textContent, how.textContent] = isEmpty ? FILL : STEPS[index];
  }

  return (state) => {
    isEmpty = state.isEmpty;
    const followed = Object.entries(state.done).filter(([, isDone]) => isDone);
    finish(followed.map(([name]) => name));
  };
});
