// The list of guidance terms in viser's panel: tools to add terms, and one row per term
// with its strength, switch, values, and what is said of it.
pdOverlay.define("guidance_panel", (api) => {
  const { icon } = pdOverlay.guidance;
  const HOST = "[data-pd-host='guidance']";
  const box = api.make("div", "pd-hosted pd-guidance");
  const tools = api.make("div", "pd-guidance-tools", {
    role: "toolbar", "aria-label": "Add guidance",
  });
  const about = api.make("div", "pd-guidance-about");
  const list = api.make("ul", "pd-guidance-list", { "aria-label": "Guidance terms" });
  const foot = api.make("div", "pd-guidance-foot", { role: "status" });
  const run = api.make("button", "pd-guidance-run", { type: "button" });
  run.addEventListener("click", () => send({ kind: "run" }));
  box.append(about, tools, run, foot, list);
  let state = { tools: [], rows: [], weights: [], report: [], figures: [] };
  let version = null;
  const rows = new Map();

  // viser draws the panel anew when tabs are dragged; the list follows its place.
  function attach() {
    const host = document.querySelector(HOST);
    if (host && box.parentElement !== host) host.replaceChildren(box);
  }
  const observer = new MutationObserver(attach);
  observer.observe(document.body, { subtree: true, childList: true });
  api.onDispose(() => {
    observer.disconnect();
    box.remove();
  });

  const send = (event) => api.send({ ...event, version });

  function showTools() {
    tools.replaceChildren(...state.tools.map((tool) => {
      const button = api.make("button", "pd-guidance-tool", {
        type: "button", title: tool.hint, "aria-label": tool.title,
        "aria-pressed": String(tool.isActive), "aria-disabled": String(!tool.isEnabled),
      });
      button.append(icon(tool.kind), api.make("span", "", {}, tool.title));
      button.addEventListener("click", () => send({ kind: "tool", tool: tool.kind }));
      return button;
    }));
  }

  function number(row, input) {
    const field = api.make("input", "", {
      type: "number", min: input.least, max: input.most, step: input.step,
      "aria-label": `${input.label} of ${row.name}`, placeholder: input.empty,
    });
    field.value = input.value ?? "";
    field.addEventListener("change", () => {
      const value = field.value === "" ? null : Number(field.value);
      send({ kind: "input", index: row.index, name: input.name, value });
    });
    return field;
  }

  function choice(row, input) {
    const field = api.make("select", "", { "aria-label": `${input.label} of ${row.name}` });
    for (const option of input.options)
      field.append(api.make("option", "", { value: option }, option));
    field.value = input.value;
    field.addEventListener("change", () =>
      send({ kind: "input", index: row.index, name: input.name, value: field.value }));
    return field;
  }

  function inputs(row) {
    const line = api.make("div", "pd-guidance-inputs");
    for (const input of row.inputs) {
      const label = api.make("label", "", {}, input.label);
      label.append(input.options.length ? choice(row, input) : number(row, input));
      if (input.unit) label.append(api.make("span", "", {}, input.unit));
      line.append(label);
    }
    return line;
  }

  function strength(row) {
    const label = api.make("label", "pd-guidance-strength", {}, "Strength");
    const slider = api.make("input", "", {
      type: "range", min: 0, max: state.weights.length - 1, step: 1,
      "aria-label": `Strength of ${row.name}`,
    });
    const told = api.make("output", "");
    const tell = () => { told.textContent = `\u00d7${state.weights[slider.value]}`; };
    slider.value = row.stop;
    tell();
    const weigh = (isEnd) =>
      send({ kind: "weight", index: row.index, stop: Number(slider.value), isEnd });
    slider.addEventListener("input", () => {
      tell();
      weigh(false);
    });
    slider.addEventListener("change", () => weigh(true));
    label.append(slider, told);
    return label;
  }

  function build(row) {
    const item = api.make("li", "pd-guidance-row", { "aria-label": row.name });
    const head = api.make("div", "pd-guidance-head");
    const choose = api.make("button", "pd-guidance-title", {
      type: "button", title: `Select ${row.agents}`,
    });
    const words = api.make("span", "pd-guidance-words");
    words.append(
      api.make("b", "", {}, row.title), api.make("span", "", {}, row.agents));
    choose.append(icon(row.kind), words);
    choose.addEventListener("click", () => send({ kind: "choose", index: row.index }));
    const isOn = api.make("input", "", {
      type: "checkbox", role: "switch", title: "On or off",
      "aria-label": `${row.name} is on`,
    });
    isOn.checked = row.isOn;
    isOn.addEventListener("change", () =>
      send({ kind: "switch", index: row.index, isOn: isOn.checked }));
    const remove = api.make("button", "pd-guidance-remove", {
      type: "button", title: "Delete", "aria-label": `Delete ${row.name}`,
    }, "\u00d7");
    remove.addEventListener("click", () => send({ kind: "remove", index: row.index }));
    head.append(choose, isOn, remove);
    item.append(head, inputs(row), strength(row), api.make("div", "pd-guidance-notes"));
    return item;
  }

  function showNotes(item, row) {
    const notes = item.querySelector(".pd-guidance-notes");
    notes.replaceChildren(...row.notes.map(({ tone, text }) =>
      api.make("div", `pd-guidance-note pd-tone-${tone}`, {}, text)));
  }

  // A row that is only told something new keeps its inputs, and with them the focus and
  // a slider that is being dragged.
  function showRows() {
    const former = new Map(rows);
    rows.clear();
    const items = state.rows.map((row) => {
      const { notes, isChosen, ...made } = row;
      const key = JSON.stringify([made, state.refusals]);
      const known = former.get(row.index);
      const isHeld = known?.item.contains(document.activeElement) &&
        document.activeElement.type === "range" && known.name === row.name;
      const item = known && (known.key === key || isHeld) ? known.item : build(row);
      rows.set(row.index, { key, item, name: row.name });
      item.classList.toggle("pd-guidance-off", !row.isOn);
      item.classList.toggle("pd-guidance-chosen", isChosen);
      showNotes(item, row);
      return item;
    });
    if (items.length !== list.children.length ||
        items.some((item, place) => list.children[place] !== item)) {
      const focus = document.activeElement?.getAttribute?.("aria-label");
      list.replaceChildren(...items);
      if (focus && !list.contains(document.activeElement))
        [...list.querySelectorAll("[aria-label]")].find(
          (one) => one.getAttribute("aria-label") === focus)?.focus();
    }
  }

  function figures() {
    const table = api.make("table", "", { "aria-label": "Realism of the last run" });
    for (const [place, [name, guided, unguided, title]] of state.figures.entries()) {
      const line = api.make("tr", "", { title });
      for (const cell of [name, guided, unguided])
        line.append(api.make(place ? "td" : "th", "", {}, cell));
      table.append(line);
    }
    return table;
  }

  function showFoot() {
    foot.replaceChildren(...state.report.map(({ tone, text }) =>
      api.make("div", `pd-guidance-note pd-tone-${tone}`, {}, text)));
    if (state.figures.length) foot.append(figures());
    foot.hidden = !state.report.length && !state.action;
    if (!state.action) return;
    const button = api.make("button", "pd-guidance-take", { type: "button" }, state.action);
    button.addEventListener("click", () => send({ kind: "take" }));
    foot.append(button);
  }

  return (next) => {
    state = next;
    version = next.version;
    attach();
    about.textContent = state.about;
    run.textContent = state.run.label;
    run.disabled = !state.run.isEnabled;
    showTools();
    showRows();
    showFoot();
    list.querySelector(".pd-guidance-chosen")?.scrollIntoView?.({ block: "nearest" });
  };
});
