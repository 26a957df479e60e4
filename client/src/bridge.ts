// All that this client knows of viser's page. Every other file asks this one, so that a
// change of viser is mended here; `missing()` tells what a page lacks.
import type { Pixel, Point, Ray } from "./geometry.ts";

/** A vector of three.js, as far as it is used. */
export interface Vector {
  x: number;
  y: number;
  z: number;
  clone(): Vector;
  set(x: number, y: number, z: number): Vector;
  add(other: Vector): Vector;
  sub(other: Vector): Vector;
  multiplyScalar(factor: number): Vector;
  length(): number;
  setLength(length: number): Vector;
  distanceTo(other: Vector): number;
  applyMatrix4(matrix: unknown): Vector;
  project(camera: Camera): Vector;
  unproject(camera: Camera): Vector;
}
export interface Camera {
  readonly position: Vector;
  readonly matrixWorld: { readonly elements: readonly number[] };
  readonly matrixWorldInverse: unknown;
  readonly fov: number;
  near: number;
  far: number;
  updateProjectionMatrix(): void;
}
interface Part {
  readonly isMesh?: boolean;
  readonly uuid: string;
  readonly material?: {
    readonly uniforms?: {
      readonly screenspace?: unknown;
      readonly thickness: { value: number };
      readonly size: { value: { set(x: number, y: number): void } };
    };
  };
}
interface SceneNode {
  worldToLocal(vector: Vector): Vector;
  localToWorld(vector: Vector): Vector;
  traverse?(visit: (part: Part) => void): void;
}
/** The controls of the camera. */
export interface Controls {
  enabled: boolean;
  azimuthRotateSpeed: number;
  polarRotateSpeed: number;
  maxPolarAngle: number;
  mouseButtons?: { left: number; right: number; middle: number };
  getPosition(into: Vector, atEnd: boolean): void;
  getTarget(into: Vector, atEnd: boolean): void;
  setLookAt(...place: [number, number, number, number, number, number, boolean]): void;
}
interface Viewer {
  readonly camera?: Camera;
  readonly canvas?: HTMLCanvasElement;
  readonly canvas2d?: HTMLCanvasElement;
  readonly nodeRefFromName?: Readonly<Record<string, SceneNode | undefined>>;
  readonly cameraControl?: Controls;
  readonly messageQueue?: { readonly length: number };
  sendMessage?(message: object): void;
  requestRender?(): void;
}
declare global {
  interface Window {
    __viserMutable?: Viewer;
    __viserPointer?: { cameraLockReasons?(): readonly string[] };
    __viserTestpoints?: { devSettings?: { set?(settings: object): void } };
  }
}

const viewer = (): Viewer => window.__viserMutable ?? {};
const world = (): SceneNode | undefined => viewer().nodeRefFromName?.[""];

export const camera = (): Camera | null => viewer().camera ?? null;
export const canvas = (): HTMLCanvasElement | null => viewer().canvas ?? null;

/** What a page of viser should have, and has not; each is what does not work without it. */
export function missing(): string[] {
  const found = viewer();
  const wanted: [unknown, string][] = [
    [found.canvas, "the picture"],
    [found.camera && world(), "places on the picture"],
    [found.sendMessage, "answers of the page"],
    [controls(), "zoom to the pointer and panning"],
    [found.requestRender && found.messageQueue, "changes of the picture at once"],
    [window.__viserPointer?.cameraLockReasons, "drags of agents from above"],
    [window.__viserTestpoints?.devSettings?.set, "a picture without a cross"],
    [document.querySelector(TAB), "the panel"],
  ];
  return wanted.filter(([one]) => !one).map(([, what]) => what);
}

/** Give the server the value of a hidden input. */
export function sendValue(uuid: string, value: string): void {
  viewer().sendMessage?.({ type: "GuiUpdateMessage", uuid, updates: { value } });
}
/** Another function for each connection, and for none. */
export const connection = (): unknown => viewer().sendMessage;

/** A point of the scene in metres, in the coordinates that three.js draws. */
export function toWorld(vector: Vector): Vector {
  return world()?.localToWorld(vector) ?? vector;
}
export function toScene(vector: Vector): Vector {
  return world()?.worldToLocal(vector) ?? vector;
}

/** A point of the scene (x, y, z in metres) in pixels of the picture; null behind the camera. */
export function project(point: Point): Pixel | null {
  const [seen, element] = [camera(), canvas()];
  if (!seen || !world() || !element) return null;
  const vector = toWorld(seen.position.clone().set(point[0], point[1], point[2] ?? 0));
  if (vector.clone().applyMatrix4(seen.matrixWorldInverse).z >= 0) return null;
  vector.project(seen);
  return [(0.5 + vector.x / 2) * element.clientWidth, (0.5 - vector.y / 2) * element.clientHeight];
}

/** The ray through a pixel of the picture: the eye, and a point further along, in metres. */
export function ray(x: number, y: number): Ray | null {
  const [seen, element] = [camera(), canvas()];
  if (!seen || !world() || !element) return null;
  const at = [(2 * x) / element.clientWidth - 1, 1 - (2 * y) / element.clientHeight] as const;
  const far = toScene(seen.position.clone().set(at[0], at[1], 0.5).unproject(seen));
  const eye = toScene(seen.position.clone());
  return [
    [eye.x, eye.y, eye.z],
    [far.x, far.y, far.z],
  ];
}

/** The point of the ground (z = 0) under a pixel of the picture; null for the sky. */
export function ground(x: number, y: number): Pixel | null {
  const found = ray(x, y);
  if (!found) return null;
  const [eye, far] = found;
  const fall = eye[2] - far[2];
  if (fall <= 1e-9) return null;
  const reach = eye[2] / fall;
  return [eye[0] + reach * (far[0] - eye[0]), eye[1] + reach * (far[1] - eye[1])];
}

export function controls(): Controls | null {
  const found = viewer().cameraControl;
  const names = ["getPosition", "getTarget", "setLookAt"] as const;
  const isCapable = found && world() && names.every((name) => typeof found[name] === "function");
  return isCapable ? found : null;
}

/** Which gestures viser's controls keep: turning by the left button, or none. */
export function keepGestures(found: Controls, turns: boolean): void {
  // viser's cross where the camera turns about; it says nothing to a user.
  window.__viserTestpoints?.devSettings?.set?.({ enableOrbitCrosshair: false });
  const { ACTION } = found.constructor as { ACTION?: { NONE?: number; ROTATE?: number } };
  const none = ACTION?.NONE ?? 0;
  found.azimuthRotateSpeed = found.polarRotateSpeed = turns ? 1 : 0;
  if (found.mouseButtons)
    Object.assign(found.mouseButtons, { left: turns ? (ACTION?.ROTATE ?? 1) : none, right: none, middle: none });
}

export const requestRender = (): void => viewer().requestRender?.();
export const hasMessages = (): boolean => Boolean(viewer().messageQueue?.length);

/** Name of the mesh that a node draws now; empty without one. */
export function meshOf(name: string): string {
  let found = "";
  viewer().nodeRefFromName?.[name]?.traverse?.((part) => {
    if (!found && part.isMesh) found = part.uuid;
  });
  return found;
}

/** Draw the outline of what the pointer is on so many pixels wide, where nodes begin so. */
export function outline(prefix: string, width: number): void {
  const element = canvas();
  if (!element) return;
  for (const [name, node] of Object.entries(viewer().nodeRefFromName ?? {})) {
    if (!name.startsWith(prefix)) continue;
    node?.traverse?.(({ material }) => {
      const uniforms = material?.uniforms;
      if (uniforms?.screenspace === undefined) return;
      uniforms.thickness.value = width;
      uniforms.size.value.set(element.width, element.height);
    });
  }
}

export const dragsNode = (): boolean => Boolean(window.__viserPointer?.cameraLockReasons?.().includes("node-drag"));
/** Show or hide the box that viser draws for a selection. */
export function showBox(isShown: boolean): void {
  const box = viewer().canvas2d;
  if (box) box.style.visibility = isShown ? "" : "hidden";
}

// Parts of viser's panel.
export const TAB = "[role=tab]";
export const SCROLLED = "[data-scrollarea-viewport]";
export const LIST = "input.mantine-Select-input";
export const SLIDER = "[class*=Slider-root]";
export const FIELD = ".mantine-NumberInput-root, .mantine-TextInput-root";
export const NUMBER = "input:is(.mantine-NumberInput-input, [type=number])";
/** What opens and closes a folder. */
export const FOLD = ".mantine-Paper-root[data-with-border] > .mantine-Paper-root";
export const DIALOG = ".mantine-Modal-content";
export const BESIDE_DIALOG = ".mantine-Modal-inner, .mantine-Modal-overlay";

/** Take away what is told again, as by a server that came back, and that a file has come:
 * what became of it is told, or seen. */
export function hideNeedless(): void {
  const told = new Set<string>();
  for (const notice of [...document.querySelectorAll<HTMLElement>(".mantine-Notification-root")].reverse()) {
    const text = notice.textContent ?? "";
    const isNew = !told.has(text) && !text.endsWith("File uploaded successfully.");
    told.add(text);
    if (isNew || notice.style.display) continue;
    notice.style.display = "none";
    notice.querySelector<HTMLElement>(".mantine-Notification-closeButton")?.click();
  }
}

const ICON_NAMES: readonly [selector: string, name: string][] = [
  [".mantine-Notification-closeButton", "Close the notice"],
  ["button:has(> * > .tabler-icon-list-search)", "All commands"],
  ["button:has(> * > .tabler-icon-adjustments)", "Settings of viser"],
];
/** Name controls for screen readers: viser labels neither sliders, texts, second numbers nor folds. */
export function nameControls(): void {
  for (const fold of document.querySelectorAll<HTMLElement>(FOLD)) {
    fold.tabIndex = 0;
    fold.role = "button";
    fold.ariaExpanded = String(!fold.nextElementSibling?.matches("[inert]"));
  }
  for (const [selector, name] of ICON_NAMES)
    for (const found of document.querySelectorAll(`${selector}:not([aria-label])`))
      found.setAttribute("aria-label", name);
  for (const label of document.querySelectorAll<HTMLLabelElement>("p > label[for]")) {
    const row = label.closest("p")?.parentElement?.parentElement;
    const fields = [...(row?.querySelectorAll<HTMLElement>("[role=slider], input:not([type=hidden])") ?? [])];
    for (const [index, field] of fields.entries()) {
      if (field.getAttribute("aria-label") || (field instanceof HTMLInputElement && field.labels?.length)) continue;
      const isFirst = index === 0 || fields[0].matches("[role=slider]");
      field.setAttribute("aria-label", `${label.textContent}${isFirst ? "" : `, number ${index + 1}`}`);
    }
  }
}

/** Open a tab: docked ones, which can be dragged, listen to presses and keys. */
export function openTab(tab: HTMLElement): void {
  tab.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
  if (tab.getAttribute("aria-selected") !== "true") tab.click();
}

/** Whether a field drops points and letters, which React alone knows; native ones have a step of 1. */
export function isWhole(field: HTMLInputElement): boolean {
  if (field.type === "number") return !field.step;
  interface Fiber {
    memoizedProps?: { decimalScale?: number } | null;
    return?: Fiber | null;
  }
  const known = field as unknown as Record<string, Fiber | undefined>;
  let fiber: Fiber | null | undefined = known[Object.keys(field).find((key) => key.startsWith("__reactFiber")) ?? ""];
  while (fiber && fiber.memoizedProps?.decimalScale === undefined) fiber = fiber.return;
  return fiber?.memoizedProps?.decimalScale === 0;
}

const CARET_MS = 100;
/** Set a field as if its text were typed, for React keeps what it knows. */
export function typeInto(field: HTMLInputElement, text: string): void {
  const property = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value");
  // A field of numbers that is left would take the focus again, to place its caret.
  Object.assign(field, { focus: () => {} });
  setTimeout(() => Reflect.deleteProperty(field, "focus"), CARET_MS);
  // Emptied first: it compares a text with what it knows of the caret.
  for (const one of ["", text]) {
    property?.set?.call(field, one);
    field.dispatchEvent(new Event("input", { bubbles: true }));
  }
}

/** viser moves the camera while such a key is held; it believes the key was let go at once. */
export function letKeyGo(event: KeyboardEvent): void {
  if (/^(Key[WASDQE]|Arrow(Up|Down|Left|Right))$/.test(event.code))
    document.dispatchEvent(new KeyboardEvent("keyup", { code: event.code }));
}

/** Let viser hear of other keys in the place of those that were pressed. */
export function pressAlso(event: KeyboardEvent, keys: KeyboardEventInit): void {
  const { ctrlKey, metaKey } = event;
  event.preventDefault();
  const other = { ctrlKey, metaKey, bubbles: true, cancelable: true, ...keys };
  document.body.dispatchEvent(new KeyboardEvent("keydown", other));
}

/** Open viser's list of commands. */
export const openCommands = (event: KeyboardEvent): void => pressAlso(event, { key: "k", code: "KeyK" });
