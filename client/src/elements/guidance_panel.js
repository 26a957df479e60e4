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
  const ask = api.make("button", "pd-guidance-ask", { type: "button" });
  ask.addEventListener("click", () => send({ kind: "look" }));
  const possible = api.make("div", "pd-possible");
  possible.addEventListener("pointerleave", () => point(null));
  const list = api.make("ul", "pd-guidance-list", { "aria-label": "Guidance terms" });
  const foot = api.make("div", "pd-guidance-foot", { role: "status" });
  const run = api.make("button", "pd-guidance-run", { type: "button" });
  const runAll = api.make("button", "pd-guidance-all", {
    type: "button", title: "Regenerate the trajectories of all agents",
  });
  run.addEventListener("click", () => send({ kind: "run", isAll: false }));
  runAll.addEventListener("click", () => send({ kind: "run", isAll: true }));
  const runs = api.make("div", "pd-guidance-runs");
  runs.append(run, runAll);
  box.append(about, tools, ask, possible, runs, foot, list);
  let state = {
    tools: [], encounters: { items: [] }, rows: [], weights: [], report: [],
    figures: [], answered: 0,
  };
  let version = null;
  let count = 0;
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

  // Returns the number of the event, which the reply to it names.
  function send(event) {
    count += 1;
    api.send({ ...event, version, count });
    return count;
  }

  // What could happen: one line per encounter; its place in the list is its number.
  function point(number) {
    if (state.encounters.items.findIndex((one) => one.isPointed) !== (number ?? -1))
      send({ kind: "point", number });
  }

  // The list and its arcs are of this tab.
  api.listen(window, "click", ({ target }) => {
    const tab = target.closest?.("[role=tab]");
    if (tab && tab.textContent.trim() !== "Guide" && state.encounters.isOpen)
      send({ kind: "leave" });
  });

  function showPossible() {
    const { label, isEnabled, isOpen, about: told, items } = state.encounters;
    ask.textContent = label;
    ask.disabled = !isEnabled;
    ask.setAttribute("aria-expanded", String(isOpen));
    possible.hidden = !told;
    // Lines stay while they are pressed.
    const make = JSON.stringify([told, items.map(({ agent, text }) => [agent, text])]);
    if (make !== possible.dataset.make) {
      possible.dataset.make = make;
      possible.replaceChildren(
        api.make("div", "pd-guidance-about", { role: "status" }, told));
      possible.append(...items.map((item, number) => {
        const line = api.make("button", `pd-possible-line pd-guide-${item.kind}`, {
          type: "button",
        });
        line.append(icon(item.kind, 15), api.make("b", "", {}, item.agent),
          api.make("span", "", {}, item.text));
        for (const name of ["pointerenter", "focus"])
          line.addEventListener(name, () => point(number));
        line.addEventListener("click", () => send({ kind: "make", number }));
        return line;
      }));
    }
    for (const [number, item] of items.entries()) {
      const line = possible.children[number + 1];
      line.setAttribute("aria-pressed", String(item.isMade));
      line.classList.toggle("pd-possible-pointed", item.isPointed);
    }
  }

  // An input of a row shows what is in force, but keeps what the user is giving it: until
  // that is complete, and then until it is answered. ``show(row)`` sets the input, and
  // ``give()`` sends its value.
  function control(field, row, show, give) {
    let shown = row;
    let awaited = 0;
    const follow = (next) => {
      shown = next;
      if (awaited <= state.answered) show(next);
    };
    field.addEventListener("input", () => { awaited = Infinity; });
    field.addEventListener("change", () => { awaited = give(); });
    field.addEventListener("blur", () => {
      if (awaited < Infinity) return;
      // It was changed back, which is no change.
      awaited = 0;
      show(shown);
    });
    show(row);
    return follow;
  }

  // A field that is set loses its caret and its selection.
  function setText(field, text) {
    if (field.value !== text || field.validity.badInput) field.value = text;
  }

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

  function number(row, place) {
    const input = row.inputs[place];
    const field = api.make("input", "", {
      type: "number", min: input.least, max: input.most, step: input.step,
      "aria-label": `${input.label} of ${row.name}`, placeholder: input.empty,
    });
    return [field, control(
      field, row,
      (next) => setText(field, String(next.inputs[place].value ?? "")),
      () => {
        const value = field.value === "" ? null : Number(field.value);
        return send({ kind: "input", index: row.index, name: input.name, value });
      })];
  }

  function choice(row, place) {
    const input = row.inputs[place];
    const field = api.make("select", "", { "aria-label": `${input.label} of ${row.name}` });
    for (const option of input.options)
      field.append(api.make("option", "", { value: option }, option));
    return [field, control(
      field, row,
      (next) => {
        const { value, notes } = next.inputs[place];
        for (const option of field.options) {
          const [few, sentence] = notes[option.value] ?? ["", ""];
          option.textContent = few ? `${option.value} \u2013 ${few}` : option.value;
          option.title = sentence;
        }
        field.value = value;
      },
      () => send({
        kind: "input", index: row.index, name: input.name, value: field.value,
      }))];
  }

  function inputs(row, controls) {
    const line = api.make("div", "pd-guidance-inputs");
    for (const [place, input] of row.inputs.entries()) {
      const label = api.make("label", "", {}, input.label);
      const [field, follow] = (input.options.length ? choice : number)(row, place);
      controls.push(follow);
      label.append(field);
      if (input.unit) label.append(api.make("span", "", {}, input.unit));
      line.append(label);
    }
    return line;
  }

  function strength(row, controls) {
    const label = api.make("label", "pd-guidance-strength", {}, "Strength");
    const slider = api.make("input", "", {
      type: "range", min: 0, max: state.weights.length - 1, step: 1,
      "aria-label": `Strength of ${row.name}`,
    });
    const told = api.make("output", "");
    const tell = () => { told.textContent = `\u00d7${state.weights[slider.value]}`; };
    const weigh = (isEnd) =>
      send({ kind: "weight", index: row.index, stop: Number(slider.value), isEnd });
    slider.addEventListener("input", () => {
      tell();
      weigh(false);
    });
    controls.push(control(
      slider, row,
      (next) => {
        slider.value = next.stop;
        tell();
      },
      () => weigh(true)));
    label.append(slider, told);
    return label;
  }

  function build(row) {
    const controls = [];
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
    controls.push(control(
      isOn, row,
      (next) => { isOn.checked = next.isOn; },
      () => send({ kind: "switch", index: row.index, isOn: isOn.checked })));
    const remove = api.make("button", "pd-guidance-remove", {
      type: "button", title: "Delete", "aria-label": `Delete ${row.name}`,
    }, "\u00d7");
    remove.addEventListener("click", () => send({ kind: "remove", index: row.index }));
    head.append(choose, isOn, remove);
    item.append(
      head, inputs(row, controls), strength(row, controls),
      api.make("div", "pd-guidance-notes"));
    return { item, controls };
  }

  function showNotes(item, row) {
    const notes = item.querySelector(".pd-guidance-notes");
    notes.replaceChildren(...row.notes.map(({ tone, text }) =>
      api.make("div", `pd-guidance-note pd-tone-${tone}`, {}, text)));
  }

  // What a row is built of; the rest of it can be shown by a row that is there.
  function makeOf(row) {
    const { notes, isChosen, isOn, stop, ...made } = row;
    const inputs = row.inputs.map(({ value, notes, ...input }) => input);
    return JSON.stringify({ ...made, inputs });
  }

  // A row stays as long as it can, and with it the focus and what is typed or dragged.
  function showRows() {
    const former = new Map(rows);
    rows.clear();
    const items = state.rows.map((row) => {
      const make = makeOf(row);
      const known = former.get(row.index);
      const { item, controls } = known?.make === make ? known : build(row);
      rows.set(row.index, { make, item, controls });
      for (const follow of controls) follow(row);
      item.classList.toggle("pd-guidance-off", !row.isOn);
      item.classList.toggle("pd-guidance-chosen", row.isChosen);
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
    run.title = state.run.label;
    runAll.textContent = state.run.all;
    runAll.hidden = !state.run.all;
    run.disabled = runAll.disabled = !state.run.isEnabled;
    showTools();
    showPossible();
    showRows();
    showFoot();
    list.querySelector(".pd-guidance-chosen")?.scrollIntoView?.({ block: "nearest" });
  };
});
