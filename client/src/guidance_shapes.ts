// Icons and shapes of guidance terms, shared by marks, drawing mode and list.
import { icon, svg } from "./dom.ts";
import { guidanceIcons } from "./frame.ts";

export function guidanceIcon(kind: string, size = 18): SVGSVGElement {
  const picture = icon(guidanceIcons[kind] ?? "", 20, "pd-guide-icon");
  picture.setAttribute("width", String(size));
  picture.setAttribute("height", String(size));
  return picture;
}

/** An icon on a round plate, around the origin. */
export function plate(kind: string, radius = 11): SVGGElement {
  const group = svg("g", "pd-guide-plate");
  const inner = svg("g", "", { transform: "translate(-8 -8) scale(0.8)" });
  inner.append(svg("path", "", { d: guidanceIcons[kind] ?? "" }));
  group.append(svg("circle", "", { r: radius }), inner);
  return group;
}

/** A flag whose foot is the origin. That of an offer leaves the ground beside to agents. */
export function flag(isOffer = false): SVGGElement {
  const group = svg("g", "pd-guide-flag");
  const cloth = "M0 -29H19L14 -22.5L19 -16H0z";
  const hit = isOffer ? "M-6 -34H23V-12H8V6H-8V-12H-6z" : "M-9 -34H24V8H-9z";
  group.append(
    svg("path", "pd-guide-hit", { d: hit }),
    svg("ellipse", "pd-guide-foot", { rx: 6, ry: 3.4 }),
    svg("path", "pd-guide-halo", { d: `M0 0V-29${cloth}` }),
    svg("path", "pd-guide-cloth", { d: cloth }),
    svg("path", "pd-guide-pole", { d: "M0 0V-30" }),
  );
  return group;
}

/** A line with an edge that stands out from the picture. */
export function haloed(line: string): SVGPathElement[] {
  return ["pd-guide-halo", "pd-guide-line"].map((name) => svg("path", name, { d: line }));
}
