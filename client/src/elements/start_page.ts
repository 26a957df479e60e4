// The page of all scenarios over the picture: arrows walk, Enter opens, S saves, X rejects.
//
// Pictures are asked for when their tiles come into sight, and move under pointer or focus.
import { button, fill, hasModifier, icon, make, option, within } from "../dom.ts";
import { define, hearFirst, onDispose, root, take } from "../frame.ts";
import { clamp } from "../geometry.ts";
import type { SceneTile, StartPageEvent, StartPageState } from "../messages.ts";

const STANDS = ' begin="indefinite"';
const MOST_PICTURES = 400;
const LINE_PAUSE_MS = 200;
const KEEPS = "M10 2.6l2.3 4.7 5.2.7-3.8 3.6.9 5.1L10 14.3l-4.6 2.4.9-5.1L2.5 8l5.2-.7z";
const REJECTS = "M5 5l10 10M15 5L5 15";
const TICKS = "M4.5 10.5l3.5 3.5 7.5-8";
const reduced = window.matchMedia("(prefers-reduced-motion: reduce)");
const pictures = new Map<string, string>();
let drawPicture: (name: string) => void = () => {};

const asImage = (text: string): string => `data:image/svg+xml,${encodeURIComponent(text)}`;

define("startPage", (api) => {
  let state: StartPageState | null = null;
  let cursor = 0; // index in the whole list
  let takesFocus = false;
  let asked = new Set<string>();
  let drawn: StartPageState["bulk"] = [];

  const page = make("section", "pd-start-page", { "aria-label": "All scenarios" });
  const sources = make("div", "pd-start-sources", { role: "tablist", "aria-label": "Sources" });
  const line = make("input", "pd-start-line", {
    type: "search",
    placeholder: "Find words, or what happens: cut-in and density > 20",
    "aria-label": "Find",
    maxlength: 500,
    spellcheck: "false",
  });
  const close = button("pd-start-close", "Back to the scene", () => tell({ kind: "close" }), { title: "Close (Esc)" });
  const head = make("header", "pd-start-head");
  head.append(make("h1", "", {}, "Scenarios"), sources, line, close);
  const common = make("div", "pd-start-common", { role: "group", "aria-label": "What happens" });
  const facets = make("div", "pd-start-facets");
  const told = make("p", "pd-start-told", { role: "status" });
  const index = button("pd-start-index", "", () => tell({ kind: "index" }));
  const row = make("div", "pd-start-row");
  row.append(told, index, facets);
  const list = make("div", "pd-start-list", { role: "list", "aria-label": "Scenarios" });
  const pages = make("div", "pd-start-pages");
  const [before, after] = [-1, 1].map((by) =>
    button("", by < 0 ? "Previous" : "Next", () => turn(by), { title: by < 0 ? "Page Up" : "Page Down" }),
  );
  const range = make("span");
  pages.append(before, range, after);
  const bulk = make("div", "pd-start-bulk", { role: "toolbar", "aria-label": "For several scenarios" });
  const tags = make("input", "pd-start-line", {
    type: "text",
    placeholder: "Tags, with commas",
    "aria-label": "Tags of these",
    maxlength: 500,
    spellcheck: "false",
  });
  const doBulk = (name: string) => tell({ kind: "bulk", name, value: tags.value });
  tags.addEventListener("keydown", (event) => {
    if (event.key === "Enter") doBulk("tag");
  });
  const keys = make(
    "p",
    "pd-start-keys",
    {},
    "Arrows walk \u00b7 Enter opens \u00b7 S saves to the library \u00b7 X rejects \u00b7 / finds",
  );
  const foot = make("footer", "pd-start-foot");
  foot.append(keys, pages);
  page.append(head, common, row, list, bulk, foot);
  page.hidden = true;
  api.box.append(page);

  function tell(event: Partial<StartPageEvent> & Pick<StartPageEvent, "kind">) {
    api.send({ value: "", name: "", first: 0, keys: [], ...event });
  }
  const tiles = () => [...list.querySelectorAll<HTMLElement>(".pd-start-tile")];
  const first = () => state?.first ?? 0;
  const total = () => state?.total ?? 0;
  const size = () => state?.tiles.length ?? 0;
  const columns = () => {
    const tops = tiles().map((one) => one.parentElement?.offsetTop);
    const inFirst = tops.filter((top) => top === tops[0]).length;
    return Math.max(inFirst, 1);
  };

  const seen = new IntersectionObserver(
    (entries) => {
      const names = new Map(state?.tiles.map((one) => [one.key, one.picture]));
      const wanted = entries
        .filter((one) => one.isIntersecting)
        .map((one) => (one.target as HTMLElement).dataset.key ?? "")
        .filter((key) => !pictures.has(names.get(key) ?? ""));
      for (const key of wanted) asked.add(key);
      const open = [...asked].filter((key) => names.has(key) && !pictures.has(names.get(key) ?? ""));
      asked = new Set(open);
      if (wanted.length) tell({ kind: "draw", keys: open });
    },
    { root: list, rootMargin: "200px" },
  );
  onDispose(() => seen.disconnect());

  function show(tile: HTMLElement, moves = false) {
    const text = pictures.get(tile.dataset.picture ?? "");
    const image = tile.querySelector("img");
    if (!image) return;
    tile.classList.toggle("pd-start-drawn", text !== undefined);
    if (text) image.src = asImage(moves && !reduced.matches ? text.replaceAll(STANDS, "") : text);
  }
  drawPicture = (name) => {
    for (const tile of tiles()) if (tile.dataset.picture === name) show(tile, tile.matches(":hover, :focus"));
  };

  function walk(to: number) {
    if (!total()) return;
    const target = clamp(to, 0, total() - 1);
    cursor = target;
    const tile = tiles()[target - first()];
    if (tile) focus(tile);
    else {
      takesFocus = true;
      tell({ kind: "page", first: target });
    }
  }
  function focus(tile: HTMLElement) {
    for (const one of tiles()) one.tabIndex = one === tile ? 0 : -1;
    tile.focus({ preventScroll: true });
    tile.scrollIntoView({ block: "nearest" });
  }
  function turn(by: number) {
    const most = Math.max(total() - 1, 0);
    const target = by < 0 ? first() - 1 : first() + size();
    if (target >= 0 && target <= most) walk(target);
  }

  function tileOf(shown: SceneTile, at: number): HTMLElement {
    const box = make("div", "pd-start-box", {
      role: "listitem",
      "aria-setsize": total(),
      "aria-posinset": first() + at + 1,
    });
    const tile = make("div", "pd-start-tile", {
      role: "button",
      tabindex: "-1",
      "aria-current": String(shown.isOpen),
      title: [shown.title, ...shown.lines].join("\n"),
    });
    tile.dataset.key = shown.key;
    tile.dataset.picture = shown.picture;
    const frame = make("div", "pd-start-picture");
    frame.append(make("img", "", { alt: "", draggable: "false" }));
    if (shown.isOpen) frame.append(make("span", "pd-start-mark", {}, "In use"));
    const act = (kind: "save" | "reject" | "tick", path: string, label: string, isOn = false) => {
      const made = button(`pd-start-act pd-start-${kind}`, "", () => tell({ kind, value: shown.key }), {
        tabindex: "-1",
        "aria-label": `${label}: ${shown.title}`,
        "aria-pressed": String(isOn),
        title: label,
      });
      made.append(icon(path, 20));
      return made;
    };
    const acts = make("div", "pd-start-acts");
    if (shown.isTicked !== null) acts.append(act("tick", TICKS, "Tick (Space)", shown.isTicked ?? false));
    if (shown.canSave)
      acts.append(act("save", KEEPS, shown.isSaved ? "In the library" : "Save to the library (S)", shown.isSaved));
    if (shown.reject) acts.append(act("reject", REJECTS, `${shown.reject} (X)`));
    const words = make("div", "pd-start-words");
    words.append(
      make("strong", "", {}, shown.title),
      ...shown.lines
        .filter((text) => !text.startsWith(shown.title))
        .slice(0, 2)
        .map((text) => make("div", "", {}, text)),
    );
    if (shown.reject === "Discard for good") words.append(make("em", "", {}, "X again discards it for good"));
    tile.append(frame, words);
    box.append(tile, acts);
    tile.addEventListener("click", ({ ctrlKey, metaKey, shiftKey }) => {
      cursor = first() + at;
      const ticks = shown.isTicked !== null && (ctrlKey || metaKey || shiftKey);
      tell({ kind: ticks ? "tick" : "open", value: shown.key });
    });
    for (const type of ["pointerenter", "focusin"]) box.addEventListener(type, () => show(tile, true));
    for (const type of ["pointerleave", "focusout"]) box.addEventListener(type, () => show(tile));
    tile.addEventListener("focus", () => {
      cursor = first() + at;
    });
    return box;
  }

  function draw(next: StartPageState, isOther: boolean) {
    const hadFocus = list.contains(document.activeElement);
    const scrolled = list.scrollTop;
    seen.disconnect();
    list.replaceChildren(...next.tiles.map(tileOf));
    if (isOther) {
      list.scrollTop = 0;
      if (!takesFocus) cursor = next.first;
    } else list.scrollTop = scrolled;
    cursor = clamp(cursor, next.first, next.first + Math.max(next.tiles.length - 1, 0));
    for (const tile of tiles()) {
      show(tile);
      seen.observe(tile);
    }
    const current = tiles()[cursor - next.first];
    if (current) {
      current.tabIndex = 0;
      if (hadFocus || takesFocus) focus(current);
    }
    takesFocus = false;
  }

  function menus(next: StartPageState) {
    fill(sources, [next.sources, next.source], () =>
      next.sources.map(({ value, text }) => {
        const made = button("", "", () => tell({ kind: "source", value: String(value) }), {
          role: "tab",
          "aria-selected": String(value === next.source),
        });
        const [name, count] = text.split(" ");
        made.append(`${name} `, make("span", "", {}, count));
        return made;
      }),
    );
    const parts = next.line.split(/\s+and\s+/i);
    common.hidden = !next.common.length;
    fill(common, [next.common, parts], () =>
      next.common.map((value) =>
        button("", value, () => tell({ kind: "common", value }), { "aria-pressed": String(parts.includes(value)) }),
      ),
    );
    fill(facets, next.facets, () =>
      next.facets.map(({ name, label, value, choices }) => {
        const menu = make("select", "", { "aria-label": label });
        menu.append(...choices.map((one) => option(one.value, one.text)));
        menu.value = value;
        menu.addEventListener("change", () => tell({ kind: "facet", name, value: menu.value }));
        return menu;
      }),
    );
  }

  function showBulk(next: StartPageState) {
    bulk.hidden = !next.bulk.length;
    if (JSON.stringify(next.bulk) === JSON.stringify(drawn)) return;
    drawn = next.bulk;
    const held = bulk.contains(document.activeElement) ? (document.activeElement as HTMLElement) : null;
    const made = next.bulk.map(({ name, text, hint, isOn }) => {
      const one = button("", text, () => doBulk(name), { title: hint });
      one.dataset.name = name;
      one.disabled = !isOn;
      return one;
    });
    const [tick, ...others] = made;
    bulk.replaceChildren(...(tick ? [tick] : []), tags, ...others);
    (held === tags ? tags : made.find((one) => one.dataset.name === held?.dataset.name))?.focus();
  }

  let late: ReturnType<typeof setTimeout> | undefined;
  line.addEventListener("input", () => {
    clearTimeout(late);
    late = setTimeout(() => tell({ kind: "line", value: line.value }), LINE_PAUSE_MS);
  });

  // Keys are the page's while it covers the picture, but for those of fields and panel.
  hearFirst("keydown", (event) => {
    if (page.hidden || hasModifier(event) || ["?", "F1", "Tab"].includes(event.key)) return;
    if (within(event, "[role=dialog], .mantine-Modal-content")) return;
    const isLine = event.target === line;
    const field = within(event, "input, textarea, select, [contenteditable]");
    if (event.key === "Escape" && (isLine || !field)) {
      take(event);
      tell({ kind: "close" });
    } else if (isLine) {
      if (event.key !== "ArrowDown" && event.key !== "Enter") return;
      take(event);
      walk(cursor);
    } else if (!field) hearKey(event);
  });
  function hearKey(event: KeyboardEvent) {
    const isOurs = page.contains(event.target as Node);
    const isButton = within(event, "button, [role=tab], a") !== null;
    if (isButton && ["Enter", " "].includes(event.key)) return;
    if (!isOurs && within(event, "[role=tab], [role=slider], [role=radio]")) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const isThere = list.contains(document.activeElement);
    const by = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -columns(), ArrowDown: columns() }[key];
    const value = tiles()[cursor - first()]?.dataset.key;
    if (key === "n") {
      take(event);
      tell({ kind: "close" });
      return;
    }
    take(event);
    if (by !== undefined) walk(isThere ? cursor + by : cursor);
    else if (key === "Home") walk(0);
    else if (key === "End") walk(total() - 1);
    else if (key === "PageUp") turn(-1);
    else if (key === "PageDown") turn(1);
    else if (key === "/") line.focus();
    else if (value === undefined || !isThere) return;
    else if (key === "Enter") tell({ kind: "open", value });
    else if (key === "s") tell({ kind: "save", value });
    else if (key === "x") tell({ kind: "reject", value });
    else if (key === " ") tell({ kind: "tick", value });
  }

  return (next) => {
    const former = state;
    state = next;
    const opens = next.isOpen && !former?.isOpen;
    page.hidden = !next.isOpen;
    root.classList.toggle("pd-shows-start", next.isOpen);
    if (opens) asked.clear();
    if (!next.isOpen) return;
    menus(next);
    if (document.activeElement !== line) line.value = next.line;
    line.setAttribute("aria-invalid", String(next.isWrong));
    told.textContent = next.told;
    told.classList.toggle("pd-bad", next.isWrong);
    index.hidden = !next.index;
    index.textContent = next.index;
    // The next step, where nothing can be found before it.
    index.classList.toggle("pd-start-first", !next.total && !next.index.startsWith("Cancel"));
    row.hidden = !(next.told || next.index || next.facets.length);
    showBulk(next);
    const isSame = former?.isOpen && JSON.stringify(former.tiles) === JSON.stringify(next.tiles);
    const isOther = former?.source !== next.source || former.line !== next.line || former.first !== next.first;
    if (opens) takesFocus = true;
    if (!isSame || takesFocus) draw(next, isOther || opens);
    const isLong = next.total > next.tiles.length;
    pages.hidden = !isLong;
    range.textContent = `${next.first + 1} to ${next.first + next.tiles.length} of ${next.total}`;
    before.disabled = next.first === 0;
    after.disabled = next.first + next.tiles.length >= next.total;
  };
});

define("scene-picture", () => ({ name, picture }) => {
  pictures.delete(name);
  pictures.set(name, picture);
  const oldest = pictures.keys().next().value;
  if (pictures.size > MOST_PICTURES && oldest !== undefined) pictures.delete(oldest);
  drawPicture(name);
});
