// Hints for a first session: one at a time, each gone for good once it was followed.
pdOverlay.define("hints", (api) => {
  const KEPT = "pd-hints-done";
  const STEPS = [
    ["select", "Click a car", "to select it; Ctrl+drag selects several."],
    ["drag", "Drag it", "to move it; Shift+drag turns it."],
    ["bend", "Bend the road", "with a slider of the Road tab."],
    ["regenerate", "Regenerate", "trajectories with the key R, or in the Drive tab."],
  ];
  const FILL = ["Fill the road", "with 'As many as fit' in the Drive tab."];
  const kept = api.recall(KEPT);
  const done = new Set(Array.isArray(kept) ? kept : []);
  const card = api.make("div", "pd-solid pd-hint", {
    role: "status", "aria-label": "Hint",
  });
  const count = api.make("span", "pd-hint-count");
  const what = api.make("b");
  const how = api.make("span");
  const close = api.make("button", "", {
    type: "button", "aria-label": "Close the hints", title: "Close the hints",
  }, "\u00d7");
  card.append(count, what, how, close);
  card.hidden = true;
  let isEmpty = false;
  api.box.append(card);

  function show() {
    const index = STEPS.findIndex(([name]) => !done.has(name));
    card.hidden = index < 0;
    if (index < 0) return;
    count.textContent = isEmpty ? "" : `${index + 1} / ${STEPS.length}`;
    [what.textContent, how.textContent] = isEmpty ? FILL : STEPS[index].slice(1);
  }

  close.addEventListener("click", () => {
    STEPS.forEach(([name]) => done.add(name));
    api.remember(KEPT, [...done]);
    show();
  });

  return (state) => {
    isEmpty = state.isEmpty;
    for (const [name, isDone] of Object.entries(state.done)) if (isDone) done.add(name);
    api.remember(KEPT, [...done]);
    show();
  };
});
