// The list of guidance terms in viser's panel: tools to add terms, and one row per term
// with its strength, switch, values, and what is said of it.
import { TAB } from "../bridge.ts";
import { button, fill, make, option, within } from "../dom.ts";
import { define, listen, onDispose } from "../frame.ts";
import { guidanceIcon } from "../guidance_shapes.ts";
import type { GuidancePanelEvent, GuidancePanelState, GuidanceRow, GuidanceTool, Note } from "../messages.ts";

const HOST = "[data-pd-host='guidance']";
const NUM_FIRST_TOOLS = 3; // Of those that can be used; the others are asked for.

type Field = HTMLInputElement | HTMLSelectElement;
type Follow = (row: GuidanceRow) => void;
interface Built {
  make: string;
  item: HTMLElement;
  controls: Follow[];
}
type Sent = Omit<GuidancePanelEvent, "version" | "count">;

const noted = ({ tone, text }: Note) => make("div", `pd-guidance-note pd-tone-${tone}`, {}, text);

/** What a row is built of; the rest of it can be shown by a row that is there. */
function makeOf({ notes: _, isChosen, isOn, stop, inputs, ...made }: GuidanceRow): string {
  const built = inputs.map(({ value, notes, ...input }) => input);
  return JSON.stringify({ ...made, inputs: built });
}

/** A field that is set loses its caret and its selection. */
function setText(field: HTMLInputElement, text: string): void {
  if (field.value !== text || field.validity.badInput) field.value = text;
}

define("guidance_panel", (api) => {
  const box = make("div", "pd-hosted pd-guidance");
  const tools = make("div", "pd-guidance-tools", { role: "toolbar", "aria-label": "Add guidance" });
  const about = make("div", "pd-guidance-about");
  const ask = button("pd-guidance-ask", "", () => send({ kind: "look" }));
  const possible = make("div", "pd-possible");
  possible.addEventListener("pointerleave", () => point(null));
  const list = make("ul", "pd-guidance-list", { "aria-label": "Guidance terms" });
  const foot = make("div", "pd-guidance-foot", { role: "status" });
  box.append(about, tools, ask, possible, foot, list);
  let state: GuidancePanelState | null = null;
  let count = 0;
  let isUnfolded = false; // All tools are shown, until one is used.
  const rows = new Map<number, Built>();

  // viser draws the panel anew when tabs are dragged; the list follows its place.
  function attach() {
    const host = document.querySelector(HOST);
    if (host && box.parentElement !== host) host.replaceChildren(box);
  }
  const observer = new MutationObserver(attach);
  observer.observe(document.body, { subtree: true, childList: true });
  onDispose(() => {
    observer.disconnect();
    box.remove();
  });

  // Returns the number of the event, which the reply to it names.
  function send(event: Sent): number {
    count += 1;
    api.send({ ...event, version: state?.version ?? null, count });
    return count;
  }

  // What could happen: one line per encounter; its place in the list is its number.
  function point(number: number | null) {
    const now = state?.encounters.items.findIndex((one) => one.isPointed) ?? -1;
    if (now !== (number ?? -1)) send({ kind: "point", number });
  }

  // The list and its arcs are of this tab.
  listen(window, "click", (event) => {
    const tab = within(event, TAB);
    if (tab && tab.textContent.trim() !== "Agents" && state?.encounters.isOpen) send({ kind: "leave" });
  });

  // Beside terms that are there, what adds more is one line.
  const isShort = ({ rows }: GuidancePanelState) => rows.length > 0 && !isUnfolded;

  function showPossible(state: GuidancePanelState) {
    const { label, isEnabled, isOpen, about: told, items } = state.encounters;
    ask.textContent = label;
    ask.disabled = !isEnabled;
    ask.setAttribute("aria-expanded", String(isOpen));
    ask.hidden = isShort(state) && !isOpen;
    possible.hidden = !told;
    // Lines stay while they are pressed.
    const made = JSON.stringify([told, items.map(({ agent, text }) => [agent, text])]);
    if (made !== possible.dataset.make) {
      possible.dataset.make = made;
      const lines = items.map((item, number) => {
        const choose = () => send({ kind: "make", number });
        const line = button(`pd-possible-line pd-guide-${item.kind}`, "", choose);
        line.append(guidanceIcon(item.kind, 15), make("b", "", {}, item.agent), make("span", "", {}, item.text));
        for (const name of ["pointerenter", "focus"]) line.addEventListener(name, () => point(number));
        return line;
      });
      const head = make("div", "pd-guidance-about", { role: "status" }, told);
      possible.replaceChildren(head, ...lines);
    }
    for (const [number, item] of items.entries()) {
      const line = possible.children[number + 1];
      line.setAttribute("aria-pressed", String(item.isMade));
      line.classList.toggle("pd-possible-pointed", item.isPointed);
    }
  }

  // An input of a row shows what is in force, but keeps what the user is giving it: until
  // that is complete, and then until it is answered. `show(row)` sets the input, and
  // `give()` sends its value.
  function control(field: Field, row: GuidanceRow, show: Follow, give: () => number): Follow {
    let shown = row;
    let awaited = 0;
    field.addEventListener("input", () => {
      awaited = Number.POSITIVE_INFINITY;
    });
    field.addEventListener("change", () => {
      awaited = give();
    });
    field.addEventListener("blur", () => {
      if (Number.isFinite(awaited)) return;
      // It was changed back, which is no change.
      awaited = 0;
      show(shown);
    });
    show(row);
    return (next) => {
      shown = next;
      if (awaited <= (state?.answered ?? 0)) show(next);
    };
  }

  function toolOf({ kind, title, hint, isActive, isEnabled }: GuidanceTool) {
    const use = () => {
      isUnfolded = false;
      send({ kind: "tool", tool: kind });
    };
    const made = button("pd-guidance-tool", "", use, {
      title: hint,
      "aria-label": title,
      "aria-pressed": String(isActive),
      "aria-disabled": String(!isEnabled),
    });
    made.append(guidanceIcon(kind), make("span", "", {}, title));
    return made;
  }

  function foldOf(more: string) {
    const fold = button("pd-guidance-more", isUnfolded ? "Fewer" : more, () => {
      isUnfolded = !isUnfolded;
      if (!state) return;
      showTools(state);
      showPossible(state);
      tools.querySelector<HTMLElement>(".pd-guidance-more")?.focus();
    });
    fold.setAttribute("aria-expanded", String(isUnfolded));
    return fold;
  }

  function showTools(state: GuidancePanelState) {
    const first = state.tools.filter((tool) => tool.isEnabled).slice(0, isShort(state) ? 0 : NUM_FIRST_TOOLS);
    const isFirst = (tool: (typeof first)[number]) => tool.isActive || first.includes(tool);
    const shown = state.tools.filter((tool) => isUnfolded || isFirst(tool));
    const others = state.tools.filter((tool) => !isFirst(tool)).slice(0, 3);
    const more = `${others.map((tool) => tool.title).join(", ")} ...`;
    fill(tools, [shown, isUnfolded, more], () => [...shown.map(toolOf), foldOf(more)]);
  }

  function number(row: GuidanceRow, place: number): [Field, Follow] {
    const input = row.inputs[place];
    const field = make("input", "", {
      type: "number",
      min: String(input.least),
      max: String(input.most),
      step: String(input.step),
      "aria-label": `${input.label} of ${row.name}`,
      placeholder: input.empty,
    });
    const show: Follow = (next) => setText(field, String(next.inputs[place].value ?? ""));
    const give = () => {
      const value = field.value === "" ? null : Number(field.value);
      return send({ kind: "input", index: row.index, name: input.name, value });
    };
    return [field, control(field, row, show, give)];
  }

  function choice(row: GuidanceRow, place: number): [Field, Follow] {
    const input = row.inputs[place];
    const field = make("select", "", { "aria-label": `${input.label} of ${row.name}` });
    field.append(...input.options.map((one) => option(one, one)));
    const show: Follow = (next) => {
      const { value, notes } = next.inputs[place];
      for (const one of field.options) {
        const [few, sentence] = notes[one.value] ?? ["", ""];
        one.textContent = few ? `${one.value} \u2013 ${few}` : one.value;
        one.title = sentence;
      }
      field.value = String(value);
    };
    const give = () => send({ kind: "input", index: row.index, name: input.name, value: field.value });
    return [field, control(field, row, show, give)];
  }

  function inputs(row: GuidanceRow, controls: Follow[]) {
    const line = make("div", "pd-guidance-inputs");
    for (const [place, input] of row.inputs.entries()) {
      const label = make("label", "", {}, input.label);
      const [field, follow] = (input.options.length ? choice : number)(row, place);
      controls.push(follow);
      label.append(field);
      if (input.unit) label.append(make("span", "", {}, input.unit));
      line.append(label);
    }
    return line;
  }

  function strength(row: GuidanceRow, weights: readonly number[], controls: Follow[]) {
    const label = make("label", "pd-guidance-strength", {}, "Strength");
    const slider = make("input", "", {
      type: "range",
      min: 0,
      max: weights.length - 1,
      step: 1,
      "aria-label": `Strength of ${row.name}`,
    });
    const told = make("output");
    const tell = () => {
      told.textContent = `\u00d7${weights[Number(slider.value)]}`;
    };
    const weigh = (isEnd: boolean) => send({ kind: "weight", index: row.index, stop: Number(slider.value), isEnd });
    slider.addEventListener("input", () => {
      tell();
      weigh(false);
    });
    const show: Follow = (next) => {
      slider.value = String(next.stop);
      tell();
    };
    controls.push(control(slider, row, show, () => weigh(true)));
    label.append(slider, told);
    return label;
  }

  function build(row: GuidanceRow, weights: readonly number[]): Built {
    const controls: Follow[] = [];
    const { index, name } = row;
    const item = make("li", "pd-guidance-row", { "aria-label": name });
    const head = make("div", "pd-guidance-head");
    const choose = button("pd-guidance-title", "", () => send({ kind: "choose", index }), {
      title: `Select ${row.agents}`,
    });
    const words = make("span", "pd-guidance-words");
    words.append(make("b", "", {}, row.title), make("span", "", {}, row.agents));
    choose.append(guidanceIcon(row.kind), words);
    const isOn = make("input", "", {
      type: "checkbox",
      role: "switch",
      title: "On or off",
      "aria-label": `${name} is on`,
    });
    const show: Follow = (next) => {
      isOn.checked = next.isOn;
    };
    const give = () => send({ kind: "switch", index, isOn: isOn.checked });
    controls.push(control(isOn, row, show, give));
    const remove = button("pd-guidance-remove", "\u00d7", () => send({ kind: "remove", index }), {
      title: "Delete",
      "aria-label": `Delete ${name}`,
    });
    head.append(choose, isOn, remove);
    const notes = make("div", "pd-guidance-notes");
    controls.push((next) => notes.replaceChildren(...next.notes.map(noted)));
    item.append(head, inputs(row, controls));
    if (row.action) item.append(button("pd-guidance-take", row.action, () => send({ kind: "act", index })));
    item.append(strength(row, weights, controls), notes);
    return { make: makeOf(row), item, controls };
  }

  // A row stays as long as it can, and with it the focus and what is typed or dragged.
  function showRows(state: GuidancePanelState) {
    const former = new Map(rows);
    rows.clear();
    const items = state.rows.map((row) => {
      const known = former.get(row.index);
      const built = known?.make === makeOf(row) ? known : build(row, state.weights);
      rows.set(row.index, built);
      for (const follow of built.controls) follow(row);
      built.item.classList.toggle("pd-guidance-off", !row.isOn);
      built.item.classList.toggle("pd-guidance-chosen", row.isChosen);
      return built.item;
    });
    const isSame = items.every((item, place) => list.children[place] === item);
    if (isSame && items.length === list.children.length) return;
    const focus = document.activeElement?.getAttribute("aria-label");
    list.replaceChildren(...items);
    if (!focus || list.contains(document.activeElement)) return;
    const all = [...list.querySelectorAll<HTMLElement>("[aria-label]")];
    all.find((one) => one.getAttribute("aria-label") === focus)?.focus();
  }

  function showFoot({ report, figures, action }: GuidancePanelState) {
    foot.hidden = !report.length && !action;
    fill(foot, [report, figures, action], () => {
      const parts: Node[] = report.map(noted);
      if (figures.length) {
        const table = make("table", "", { "aria-label": "Realism of the last run" });
        for (const [place, [name, guided, unguided, title]] of figures.entries()) {
          const line = make("tr", "", { title });
          for (const cell of [name, guided, unguided]) line.append(make(place ? "td" : "th", "", {}, cell));
          table.append(line);
        }
        parts.push(table);
      }
      if (action) parts.push(button("pd-guidance-take", action, () => send({ kind: "take" })));
      return parts;
    });
  }

  return (next) => {
    state = next;
    attach();
    about.textContent = next.about;
    showTools(next);
    showPossible(next);
    showRows(next);
    showFoot(next);
    list.querySelector(".pd-guidance-chosen")?.scrollIntoView({ block: "nearest" });
  };
});
