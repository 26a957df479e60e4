// The frame that holds every element drawn over the picture.
//
// define(name, mount) registers an element. mount(api) builds its DOM into api.box and
// returns update(state). States come from Python (Overlay.show), events go back by api.send
// (Overlay.on). Elements never take pointer events except where they are .pd-solid.
import { type Camera, camera, canvas, ground, project, sendValue } from "./bridge.ts";
import { hasModifier, isTyping, make, within } from "./dom.ts";
import type { Pixel } from "./geometry.ts";
import type { Events, States } from "./messages.ts";

type Name = keyof States | "hover_outline" | "aim";
type StateOf<Of extends Name> = Of extends keyof States ? States[Of] : never;
type EventOf<Of extends Name> = Of extends keyof Events ? Events[Of] : never;
type Update<State> = (state: State) => void;
// biome-ignore lint/suspicious/noConfusingVoidType: an element without a state returns nothing
type Mount<Of extends Name> = (api: Api<Of>) => Update<StateOf<Of>> | void;

/** A press that an element has taken. */
export interface Press {
  id: number;
  at: Pixel;
}
export interface Api<Of extends Name> {
  readonly box: HTMLElement;
  send(event: EventOf<Of>): void;
}
interface Overlay {
  project: typeof project;
  ground: typeof ground;
  picture: HTMLCanvasElement | null;
  start(uuid: string, icons: Readonly<Record<string, string>>, style: string): void;
  update(name: Name, state: unknown): void;
  dispose(): void;
}
declare global {
  interface Window {
    pdOverlay?: Overlay;
  }
}

const TIP_GAP_PX = 14;
const SLIM_PX = 380; // Less holds neither timeline nor run bar in one line.
const former = window.pdOverlay;
former?.dispose();

const definitions = new Map<Name, Mount<Name>>();
const mounted = new Map<Name, Update<unknown>>();
const waiting = new Map<Name, unknown>();
/** What a click is of. A state that is drawn between its press and its release would replace it. */
const CONTROLS = "button, a, label, input:not([type=range]), [role=button], [role=option], [role=tab], [role=listitem]";
let pressed: { control: Element; id: number } | null = null;
const frameListeners: ((camera: Camera) => void)[] = [];
const cleanups: (() => void)[] = [];
let number = 0;
let answerUuid: string | null = null;
let isAlive = true;
let heard = Date.now();

export const root = make("div", "", { id: "pd-overlay" });
const style = make("style");
/** Icons of kinds of guidance, as paths on a grid of 20 x 20. */
export let guidanceIcons: Readonly<Record<string, string>> = {};
/** The picture that was there when the former connection was lost. */
export const lostPicture = former?.picture ?? null;
/** When the server was heard of last. */
export const heardAt = (): Date => new Date(heard);
export const picture = (): HTMLCanvasElement | null => overlay.picture;
export function keepPicture(element: HTMLCanvasElement): void {
  overlay.picture = element;
}

export function define<Of extends Name>(name: Of, mount: Mount<Of>): void {
  definitions.set(name, mount as unknown as Mount<Name>);
}

/** Called with the camera once per drawn frame in which the view has changed. */
export function onView(listener: (camera: Camera) => void): void {
  frameListeners.push(listener);
}
export function onDispose(cleanup: () => void): void {
  cleanups.push(cleanup);
}
/** Show a class at the page's body until the end. */
export function markBody(name: string, isOn: boolean): void {
  document.body.classList.toggle(name, isOn);
}

export function listen<Type extends keyof WindowEventMap>(
  target: EventTarget,
  type: Type,
  listener: (event: WindowEventMap[Type]) => void,
  options?: AddEventListenerOptions,
): void {
  target.addEventListener(type, listener as EventListener, options);
  cleanups.push(() => target.removeEventListener(type, listener as EventListener, options));
}
/** Hear an event before viser and before the element that it is of. */
export function hearFirst<Type extends keyof WindowEventMap>(
  type: Type,
  listener: (event: WindowEventMap[Type]) => void,
  options: AddEventListenerOptions = {},
): void {
  listen(window, type, listener, { capture: true, ...options });
}

/** Width and height of the picture, in pixels of the page. */
export function pictureSize(): { width: number; height: number } {
  const element = canvas();
  return { width: element?.clientWidth ?? 0, height: element?.clientHeight ?? 0 };
}
/** Whether a pointer event is the picture's and not that of an element above it. */
export const isOnPicture = (event: Event): boolean => event.target === canvas();
/** Where a pointer event is, in pixels of the picture. */
export function local(event: MouseEvent): Pixel {
  const box = canvas()?.getBoundingClientRect();
  return [event.clientX - (box?.left ?? 0), event.clientY - (box?.top ?? 0)];
}
/** Keep an event from viser and from the other elements. */
export function take(event: Event): void {
  event.preventDefault();
  event.stopImmediatePropagation();
}
/** Whether a left press pans (H is held), whatever mode is on. */
export const isPanPress = (): boolean => document.body.classList.contains("pd-can-pan");
/** Whether a press is one on the picture that a mode may take. */
const isModePress = (event: PointerEvent): boolean => event.button === 0 && isOnPicture(event) && !isPanPress();

/**
 * Follow a press that an element has taken to its end. `release` is called when its button
 * is let go, `giveUp` when the browser takes the pointer away, and for Escape. Each makes
 * `held` null.
 */
export function followPress<Held extends { id: number }>(
  held: () => Held | null,
  release: (event: PointerEvent, press: Held) => void,
  giveUp: () => void,
): void {
  hearFirst("pointerup", (event) => {
    const press = held();
    if (event.pointerId !== press?.id || event.button !== 0) return;
    take(event);
    release(event, press);
  });
  listen(window, "pointercancel", giveUp);
  listen(window, "blur", giveUp);
  hearFirst("keydown", (event) => {
    if (event.key !== "Escape" || !held()) return;
    take(event);
    giveUp();
  });
}

/** What a mode makes of the presses that are its own. */
interface ModeHearer<Held> {
  /** A press at a pixel; null where nothing is held by it. */
  begin(at: Pixel): Held | null;
  drag(held: Held, at: Pixel): void;
  release(held: Held, event: PointerEvent): void;
  giveUp?(): void;
  hover?(at: Pixel | null, event: PointerEvent): void;
  /** Called after each of these. */
  draw?(): void;
}
/**
 * Presses of a mode: while it is on, left presses on the picture are its own. viser does not
 * hear them, so that neither the camera turns nor a rectangle is drawn. `mark` is a class of
 * the page's body while the mode is on.
 */
export function modePress<Held extends object>(mark: string, hear: ModeHearer<Held>) {
  const press = {
    isOn: false,
    held: null as (Held & { id: number }) | null,
    giveUp() {
      if (!press.held) return;
      press.held = null;
      hear.giveUp?.();
      hear.draw?.();
    },
    turn(isOn: boolean) {
      if (!isOn) press.giveUp();
      press.isOn = isOn;
      markBody(mark, isOn);
    },
  };
  hearFirst("pointerdown", (event) => {
    if (!press.isOn || !isModePress(event)) return;
    take(event);
    const held = hear.begin(local(event));
    if (held) press.held = { ...held, id: event.pointerId };
    hear.draw?.();
  });
  hearFirst("pointermove", (event) => {
    if (!press.isOn || (press.held && event.pointerId !== press.held.id)) return;
    if (press.held) hear.drag(press.held, local(event));
    else hear.hover?.(isOnPicture(event) ? local(event) : null, event);
    hear.draw?.();
  });
  followPress(
    () => press.held,
    (event, held) => {
      press.held = null;
      hear.release(held, event);
      hear.draw?.();
    },
    press.giveUp,
  );
  onDispose(() => markBody(mark, false));
  return press;
}

/** Hear a digit of 1 to so many before viser's hot keys, which may mean something else. */
export function onDigit(count: () => number, choose: (digit: number) => void): void {
  hearFirst("keydown", (event) => {
    const digit = Number(event.key);
    if (hasModifier(event) || isTyping(event) || !Number.isInteger(digit) || digit < 1 || digit > count()) return;
    take(event);
    choose(digit);
  });
}

/** How far a key walks in a list that shows so many lines at a time; nothing for other keys. */
export function linesWalked(event: KeyboardEvent, numShown: number): number | undefined {
  const pageful = Math.max(1, Math.floor(numShown) - 1);
  return {
    ArrowDown: 1,
    ArrowUp: -1,
    PageDown: pageful,
    PageUp: -pageful,
    Home: Number.NEGATIVE_INFINITY,
    End: Number.POSITIVE_INFINITY,
  }[event.key];
}

/** Lines beside the pointer, or where there is room for them. */
export class Tip {
  private readonly box = make("div", "pd-tip", { role: "tooltip" });
  constructor(parent: HTMLElement) {
    this.hide();
    parent.append(this.box);
  }
  hide(): void {
    this.box.hidden = true;
  }
  tell(lines: readonly string[], [x, y]: Pixel): void {
    this.box.hidden = !lines.length;
    if (this.box.hidden) return;
    this.box.replaceChildren(...lines.map((line) => make("div", "", {}, line)));
    const [{ width, height }, { offsetWidth, offsetHeight }] = [pictureSize(), this.box];
    const below = y + TIP_GAP_PX;
    const fits = below + offsetHeight + 64 < height;
    this.box.style.left = `${Math.max(Math.min(x + TIP_GAP_PX, width - offsetWidth - 8), 8)}px`;
    this.box.style.top = `${fits ? below : y - offsetHeight - TIP_GAP_PX}px`;
  }
}

/** Draw again and again, once a frame of the browser. */
export function everyFrame(draw: () => void): void {
  if (!isAlive) return;
  draw();
  requestAnimationFrame(() => everyFrame(draw));
}

/** Ask the server at most once in so many milliseconds, and at last of the newest place. */
export function paced(pauseMs: number, act: () => boolean): { ask(): void; stop(): void } {
  let actedAt = Number.NEGATIVE_INFINITY;
  let late: ReturnType<typeof setTimeout> | undefined;
  function ask(): void {
    clearTimeout(late);
    const wait = actedAt + pauseMs - performance.now();
    if (wait > 0) late = setTimeout(ask, wait);
    else if (act()) actedAt = performance.now();
  }
  return { ask, stop: () => clearTimeout(late) };
}

function send(name: string, event: unknown): void {
  if (answerUuid === null) return;
  number += 1;
  sendValue(answerUuid, JSON.stringify({ number, element: name, event }));
}

function mount(name: Name, build: Mount<Name>): void {
  const box = make("div", `pd-element pd-${name}`);
  root.append(box);
  const update = build({ box, send: (event: unknown) => send(name, event) });
  // What the server has not spoken of yet would be a frame without words.
  box.hidden = Boolean(update);
  mounted.set(name, (state) => {
    box.hidden = false;
    (update as Update<unknown> | undefined)?.(state);
  });
  if (!waiting.has(name)) return;
  mounted.get(name)?.(waiting.get(name));
  waiting.delete(name);
}

function fitToCanvas(): void {
  const box = canvas()?.getBoundingClientRect();
  if (!box) return;
  root.classList.toggle("pd-slim", box.width < SLIM_PX);
  // Beside a panel that stands at the right, what is told of its controls is over the picture.
  markBody("pd-beside", box.right < innerWidth);
  document.body.style.setProperty("--pd-beside", `${innerWidth - box.right + 8}px`);
  for (const side of ["left", "top", "width", "height"] as const) {
    const text = `${box[side]}px`;
    if (root.style[side] !== text) root.style[side] = text;
  }
}

/** Show what came while a control was pressed. */
function letGo(): void {
  if (!pressed) return;
  pressed = null;
  for (const [name, state] of waiting) overlay.update(name, state);
}

let lastView = "";
function lookAtView(): void {
  const [seen, element] = [camera(), canvas()];
  if (!seen || !element) return;
  const view =
    seen.matrixWorld.elements.map((value) => value.toPrecision(7)).join() +
    [seen.fov, element.clientWidth, element.clientHeight].join();
  if (view === lastView) return;
  lastView = view;
  fitToCanvas();
  for (const listener of frameListeners) listener(seen);
}

function start(): void {
  if (!isAlive) return;
  const element = canvas();
  if (!element) {
    setTimeout(start, 50);
    return;
  }
  fitToCanvas();
  const observer = new ResizeObserver(fitToCanvas);
  observer.observe(element);
  onDispose(() => observer.disconnect());
  listen(window, "resize", fitToCanvas);
  // Space plays, wherever the focus is; it presses no button of ours.
  listen(root, "keyup", (event) => {
    if (event.key === " " && event.target instanceof HTMLButtonElement) event.preventDefault();
  });
  for (const [name, build] of definitions) mount(name, build);
  hearFirst("pointerdown", (event) => {
    const control = within(event, CONTROLS);
    pressed = control && { control, id: event.pointerId };
  });
  hearFirst("pointerup", () => setTimeout(letGo)); // after the click
  for (const type of ["pointercancel", "blur"] as const) listen(window, type, letGo);
  hearFirst("pointermove", (event) => event.buttons === 0 && letGo(), { passive: true });
  requestAnimationFrame(() => everyFrame(lookAtView));
  send("page", { kind: "ready" } satisfies Events["page"]);
}

const overlay: Overlay = {
  project,
  ground,
  picture: null,
  start(uuid, icons, text) {
    answerUuid = uuid;
    guidanceIcons = icons;
    style.textContent = text;
    start();
  },
  update(name, state) {
    heard = Date.now();
    const update = mounted.get(name);
    // A tool that is held, such as a comparison, has the pointer and shows what it does.
    const isKept = pressed && !pressed.control.hasPointerCapture(pressed.id);
    if (!update || isKept) waiting.set(name, state);
    else {
      waiting.delete(name);
      update(state);
    }
  },
  dispose() {
    isAlive = false;
    for (const cleanup of cleanups) cleanup();
    root.remove();
    style.remove();
  },
};

/** Put the frame into the page, in the place of that of the former connection. */
export function install(): void {
  document.head.append(style);
  document.body.prepend(root); // Tab comes to tools and timeline before the panel.
  window.pdOverlay = overlay;
}
