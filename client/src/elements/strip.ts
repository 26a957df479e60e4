// Strips above the timeline: a card for each sample of the last run, or for each branch of
// the history.
//
// Pictures come apart from the rest, since they are large and change less often.
import { button, closeButton, fill, make, option, svg } from "../dom.ts";
import { define, root, take } from "../frame.ts";
import { clamp } from "../geometry.ts";
import type { StripCard, StripEvent, StripState } from "../messages.ts";

type Api = Parameters<Parameters<typeof define>[1]>[0];
type Pictures = Readonly<Record<string, string>>;
const CARD_PX = 172; // a card and the gap after it
const TREE_PX = 12;
const pictures: Record<string, Pictures> = {};
const redraw: Record<string, () => void> = {};

const stripOf = (element: string, label: string) => (api: Api) => {
  const strip = make("section", "pd-solid pd-samples", { "aria-label": label });
  const head = make("div", "pd-samples-head");
  const title = make("strong", "pd-samples-title");
  const chooser = (label: string, kind: "rank" | "pick") => {
    const select = make("select", "", { "aria-label": label, title: label });
    select.addEventListener("change", () =>
      api.send({ kind, value: kind === "pick" ? Number(select.value) : select.value }),
    );
    return select;
  };
  const ranking = chooser("Order of the samples", "rank");
  const pick = chooser("Samples shown", "pick");
  const hint = "Point to preview, click to use, C compares";
  const close = closeButton(`Close the ${label.toLowerCase()}`, "Esc", () => api.send({ kind: "close" }));
  const restore = button("pd-strip-restore", "", () => api.send({ kind: "restore" }));
  head.append(title, ranking, pick, restore, make("span", "pd-samples-hint", {}, hint), close);
  const list = make("div", "pd-samples-list", {
    role: "listbox",
    "aria-label": `${label} to choose among`,
    "aria-orientation": "horizontal",
  });
  strip.append(head, list);
  strip.hidden = true;
  api.box.append(strip);

  let state: StripState | null = null;
  let cursor: number | null = null;
  let pointed: number | null = null;
  let shownInUse: number | null = null; // the card in use that was scrolled into sight

  function point(index: number | null) {
    if (pointed === index) return;
    pointed = index;
    api.send(index === null ? { kind: "leave" } : { kind: "point", value: index });
  }

  const cards = () => [...list.querySelectorAll<HTMLElement>(".pd-sample")];
  const indexOf = (card: HTMLElement) => Number(card.dataset.index);

  function moveTo(place: number) {
    const all = cards();
    if (!all.length) return;
    const card = all[clamp(place, 0, all.length - 1)];
    cursor = indexOf(card);
    for (const one of all) one.tabIndex = one === card ? 0 : -1;
    card.focus({ preventScroll: true });
    card.scrollIntoView({ block: "nearest", inline: "nearest" });
    point(cursor);
  }

  const drop = (card: HTMLElement) => {
    if (state?.cards.find((one) => one.index === indexOf(card))?.canDrop)
      api.send({ kind: "drop", value: indexOf(card) });
  };
  // The name of a branch, in the place of its words: Enter gives it, Escape keeps the former.
  function rename(card: HTMLElement) {
    const words = card.querySelector<HTMLElement>(".pd-sample-words");
    if (!words || state?.cards.find((one) => one.index === indexOf(card))?.forkOf === null) return;
    const field = make("input", "pd-sample-field", { "aria-label": "Name of the branch", maxlength: 100 });
    field.value = words.textContent;
    words.replaceWith(field);
    field.select();
    field.addEventListener("click", (event) => event.stopPropagation());
    field.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== "Escape") return;
      take(event);
      if (event.key === "Enter") api.send({ kind: "rename", value: indexOf(card), text: field.value });
      leave();
      moveTo(cards().findIndex((one) => indexOf(one) === indexOf(card)));
    });
    field.addEventListener("blur", leave);
    function leave() {
      field.removeEventListener("blur", leave);
      field.remove();
      draw();
    }
  }

  strip.addEventListener("pointerleave", () => point(null));
  strip.addEventListener("keydown", (event) => {
    const place = cards().findIndex((one) => indexOf(one) === cursor);
    const target = { ArrowLeft: place - 1, ArrowRight: place + 1, Home: 0, End: Number.POSITIVE_INFINITY }[event.key];
    const at = event.target as HTMLElement;
    const card = at.closest<HTMLElement>(".pd-sample");
    const isBranch = element === "branches" && card !== null;
    if (at.matches("select, input")) return;
    if (event.key === "Escape") api.send({ kind: "close" });
    else if (isBranch && event.key === "F2") rename(card);
    else if (isBranch && event.key === "Delete") drop(card);
    else if (target !== undefined) moveTo(target);
    else if (event.key === "Enter" && at.classList.contains("pd-sample"))
      api.send({ kind: "adopt", value: indexOf(at) });
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
  strip.addEventListener("focusout", (event) => {
    if (!strip.contains(event.relatedTarget as Node | null) && !strip.matches(":hover")) point(null);
  });

  function offer(select: HTMLSelectElement, choices: StripState["picks"], value: string | number) {
    select.hidden = !choices.length;
    fill(select, choices, () => choices.map((one) => option(one.value, one.text)));
    select.value = String(value);
  }

  function cardOf({ index, name: words, mark, isAdopted, lines, hint, canDrop, isKept, forkOf }: StripCard) {
    const box = make("div", "pd-sample-box");
    const card = make("div", "pd-sample", {
      role: "option",
      tabindex: "-1",
      "aria-selected": String(isAdopted),
      "aria-label": words,
      title: hint,
    });
    card.dataset.index = String(index);
    const picture = make("img", "", { alt: "", draggable: "false" });
    const source = pictures[element]?.[index];
    if (source) picture.src = source;
    const name = make("div", "pd-sample-name");
    name.append(make("span", "pd-sample-words", {}, words), make("span", "pd-sample-rank", {}, mark));
    card.append(
      picture,
      name,
      ...lines.map(({ text, tone }) => make("div", tone ? `pd-sample-line pd-${tone}` : "pd-sample-line", {}, text)),
    );
    card.addEventListener("pointerenter", () => point(index));
    card.addEventListener("click", () => {
      cursor = index;
      api.send({ kind: "adopt", value: index });
    });
    const tell = (kind: StripEvent["kind"]) => () => api.send({ kind, value: index });
    const more = (kind: StripEvent["kind"], sign: string, label: string, title: string, act = tell(kind)) =>
      button(`pd-sample-act pd-sample-${kind}`, sign, act, { tabindex: "-1", "aria-label": label, title });
    box.append(
      card,
      isKept
        ? more("keep", "\u2605", `In the library: ${words}`, "In the library")
        : more("keep", "\u2606", `Use and save to the library: ${words}`, "Use it and save it to the library"),
    );
    box.classList.toggle("pd-is-kept", isKept);
    if (!isAdopted)
      box.append(more("pair", "\u25eb", `Compare with the one in use: ${words}`, "Side by side with the one in use"));
    if (element === "branches" && forkOf !== null) {
      box.append(more("rename", "\u270e", `Rename: ${words}`, "Use it and give it a name (F2)", () => rename(card)));
      box.append(more("carry", "\u21f6", `On other scenes: ${words}`, "Use it and choose other scenes for its edits"));
    }
    if (canDrop) box.append(more("drop", "\u2715", `Delete: ${words}`, "Delete it from this strip (Del)"));
    return box;
  }

  // Lines above the cards, from each to those that branch off from it.
  function tree(shown: readonly StripCard[]) {
    const places = new Map(shown.map(({ index }, place) => [index, place]));
    const levels = new Map<number, number>();
    const center = (index: number) => ((places.get(index) ?? 0) + 0.5) * CARD_PX;
    const lines = shown.map(({ index, forkOf }) => {
      const level = forkOf === null ? 0 : (levels.get(forkOf) ?? 0) + 1;
      levels.set(index, level);
      if (forkOf === null) return "";
      const y = Math.min(level * 4 - 2, TREE_PX - 2);
      return `M${center(forkOf)} ${TREE_PX}V${y}H${center(index)}V${TREE_PX}`;
    });
    const width = shown.length * CARD_PX;
    const picture = svg("svg", "pd-strip-tree", { width: `${width}`, height: `${TREE_PX}`, "aria-hidden": "true" });
    picture.append(svg("path", "", { d: lines.join("") }));
    return picture;
  }

  const draw = () => {
    strip.hidden = !state?.isOpen;
    root.classList.toggle("pd-shows-samples", root.querySelector(".pd-samples.pd-solid:not([hidden])") !== null);
    if (!state?.isOpen) {
      pointed = cursor = shownInUse = null;
      return;
    }
    if (list.querySelector(".pd-sample-field")) return;
    const hadFocus = list.contains(document.activeElement);
    title.textContent = state.title;
    restore.hidden = !state.numDropped;
    restore.textContent = `Put back ${state.numDropped} deleted`;
    offer(ranking, state.rankings, state.ranking);
    offer(pick, state.picks, state.pick);
    list.replaceChildren(...state.cards.map(cardOf));
    if (state.cards.some(({ forkOf }) => forkOf !== null)) list.prepend(tree(state.cards));
    const all = cards();
    const current =
      all.find((one) => indexOf(one) === cursor) ??
      all.find((one) => one.getAttribute("aria-selected") === "true") ??
      all[0];
    if (!current) return;
    current.tabIndex = 0;
    const inUse = state.cards.find((one) => one.isAdopted)?.index ?? null;
    if (inUse !== shownInUse) {
      shownInUse = inUse;
      const card = all.find((one) => indexOf(one) === inUse);
      card?.scrollIntoView({ block: "nearest", inline: "nearest" });
    }
    if (state.takesFocus || hadFocus) moveTo(all.indexOf(current));
  };

  redraw[element] = draw;
  return (next: StripState) => {
    state = next;
    draw();
  };
};

define("samples", stripOf("samples", "Samples"));
define("branches", stripOf("branches", "Branches"));
for (const [element, name] of [
  ["samples", "sample-pictures"],
  ["branches", "branch-pictures"],
] as const)
  define(name, () => (next) => {
    pictures[element] = next.pictures;
    redraw[element]?.();
  });
