// Making and asking elements of the page. Texts are set as text alone, since ids come from
// files.
type Attributes = Readonly<Record<string, string | number>>;

function dressed<Made extends Element>(element: Made, className: string, attributes: Attributes, text: string): Made {
  if (className) element.setAttribute("class", className);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  if (text) element.textContent = text;
  return element;
}

/** make("span", "pd-key", { title: "Undo" }, "Undo") */
export function make<Tag extends keyof HTMLElementTagNameMap>(
  tag: Tag,
  className = "",
  attributes: Attributes = {},
  text = "",
): HTMLElementTagNameMap[Tag] {
  return dressed(document.createElement(tag), className, attributes, text);
}

export function svg<Tag extends keyof SVGElementTagNameMap>(
  tag: Tag,
  className = "",
  attributes: Attributes = {},
  text = "",
): SVGElementTagNameMap[Tag] {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  return dressed(element, className, attributes, text);
}

/** A picture of one path, on a square grid. */
export function icon(path: string, grid: number, className = ""): SVGSVGElement {
  const picture = svg("svg", className, { viewBox: `0 0 ${grid} ${grid}`, "aria-hidden": "true" });
  picture.append(svg("path", "", { d: path }));
  return picture;
}

export function button(
  className: string,
  text: string,
  act: () => void,
  attributes: Attributes = {},
): HTMLButtonElement {
  const element = make("button", className, { type: "button", ...attributes }, text);
  element.addEventListener("click", act);
  return element;
}

export const closeButton = (label: string, key: string, act: () => void): HTMLButtonElement =>
  button("pd-close", "\u00d7", act, { "aria-label": label, title: `Close (${key})` });

export const option = (value: string | number, text: string): HTMLOptionElement => make("option", "", { value }, text);

/** Fill a box unless it shows that already: an open list stays open, and the focus where it was. */
export function fill(box: HTMLElement, shown: unknown, parts: () => Node[]): void {
  const text = JSON.stringify(shown);
  if (box.dataset.shown === text) return;
  box.dataset.shown = text;
  const controls = () => [...box.querySelectorAll<HTMLElement>("button, select, input, [tabindex]")];
  const at = controls().indexOf(document.activeElement as HTMLElement);
  box.replaceChildren(...parts());
  controls()[at]?.focus();
}

/** The element that an event is of, or one around it. */
export const within = (event: Event, selector: string): HTMLElement | null =>
  event.target instanceof Element ? event.target.closest<HTMLElement>(selector) : null;
export const isTyping = (event: Event): boolean => within(event, "input, textarea, select, [contenteditable]") !== null;
export const hasModifier = (event: KeyboardEvent): boolean => event.ctrlKey || event.metaKey || event.altKey;

/** What the browser keeps for later visits; null where it keeps nothing. */
export function recall(key: string): unknown {
  try {
    return JSON.parse(window.localStorage.getItem(key) ?? "null");
  } catch {
    return null;
  }
}
export function remember(key: string, value: unknown): void {
  try {
    window.localStorage.setItem(key, JSON.stringify(value));
  } catch {
    // A browser that keeps nothing shows the element as on the first visit.
  }
}

/** What one element tells others. */
export class Signal<Value> {
  private readonly listeners: ((value: Value) => void)[] = [];
  listen(listener: (value: Value) => void): void {
    this.listeners.push(listener);
  }
  tell(value: Value): void {
    for (const listener of this.listeners) listener(value);
  }
}
