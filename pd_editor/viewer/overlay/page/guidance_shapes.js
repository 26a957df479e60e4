// Icons and shapes of guidance terms, shared by marks, drawing mode and list.
pdOverlay.guidance = (() => {
  const NAMESPACE = "http://www.w3.org/2000/svg";
  // Drawn on a grid of 20 x 20, to be clear at 16 pixels.
  const ICONS = {
    "goal-point": "M5.5 17.5V3M5.5 3.5H15l-2.6 3.2L15 10H5.5",
    "follow-path": "M3.5 16.5c6.5 0 3-6 6.5-7s3-6 6.5-6M13.5 2.5h3.5V6",
    "follow-lane": "M4.5 17V3M15.5 17V3M10 16.5V5M7.5 7.5 10 5l2.5 2.5",
    "stop-at-line": "M7 2.5h6L17.5 7v6L13 17.5H7L2.5 13V7zM6 10h8",
    "yield-to": "M3 4.5h14L10 16.5z",
    threaten: "M11.5 2.5 5 11h4.3L8 17.5l7-9h-4.6z",
    "target-speed": "M3.7 15a7.3 7.3 0 1 1 12.6 0M10 12l3.4-4.4",
    "speed-limit": "M10 2.5a7.5 7.5 0 1 1 0 15a7.5 7.5 0 1 1 0-15M10 6.3a3.7 3.7 0 1 1 0 7.4a3.7 3.7 0 1 1 0-7.4",
    "keep-gap": "M3 4.5v11M17 4.5v11M6 10h8M8 7.8 5.8 10 8 12.2M12 7.8l2.2 2.2-2.2 2.2",
    "avoid-collisions": "M10.5 17.5c0-6-5.5-4-5.5-10V4M2.8 6.2 5 4l2.2 2.2M12 8.5l5 5M17 8.5l-5 5",
    "stay-on-road": "M4.5 17 7.7 3M15.5 17 12.3 3M10 3.5v2.2M10 8.7v2.6M10 14.2v2.6",
    "comfort-limits": "M2.8 11.5c2.4-5 4.8-5 7.2 0s4.8 5 7.2 0",
  };

  function shape(tag, name, attributes = {}) {
    const element = document.createElementNS(NAMESPACE, tag);
    if (name) element.setAttribute("class", name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return element;
  }

  function icon(kind, size = 18) {
    const svg = shape("svg", "pd-guide-icon", {
      viewBox: "0 0 20 20", width: size, height: size, "aria-hidden": "true",
    });
    svg.append(shape("path", "", { d: ICONS[kind] ?? "" }));
    return svg;
  }

  // An icon on a round plate, around the origin.
  function plate(kind, radius = 11) {
    const group = shape("g", "pd-guide-plate");
    const inner = shape("g", "", { transform: `translate(-8 -8) scale(0.8)` });
    inner.append(shape("path", "", { d: ICONS[kind] ?? "" }));
    group.append(shape("circle", "", { r: radius }), inner);
    return group;
  }

  // A flag whose foot is the origin. That of an offer leaves the ground beside to agents.
  function flag(isOffer = false) {
    const group = shape("g", "pd-guide-flag");
    const cloth = "M0 -29H19L14 -22.5L19 -16H0z";
    group.append(
      shape("path", "pd-guide-hit", {
        d: isOffer ? "M-6 -34H23V-12H8V6H-8V-12H-6z" : "M-9 -34H24V8H-9z",
      }),
      shape("ellipse", "pd-guide-foot", { rx: 6, ry: 3.4 }),
      shape("path", "pd-guide-halo", { d: `M0 0V-29${cloth}` }),
      shape("path", "pd-guide-cloth", { d: cloth }),
      shape("path", "pd-guide-pole", { d: "M0 0V-30" }));
    return group;
  }

  const isSeen = (point) => point !== null;
  const at = (point) => point.map((value) => value.toFixed(1)).join(" ");

  // A line through pixels; what is behind the camera leaves a gap.
  function along(pixels) {
    let path = "";
    pixels.forEach((point, index) => {
      if (!isSeen(point)) return;
      path += `${index && isSeen(pixels[index - 1]) ? "L" : "M"}${at(point)}`;
    });
    return path;
  }

  // The two sides of an arrow's head at the end of a line.
  function head(pixels, size = 9) {
    const seen = pixels.filter(isSeen);
    const tip = seen.at(-1);
    const before = seen.findLast(
      (point) => Math.hypot(tip[0] - point[0], tip[1] - point[1]) > 3);
    if (!before) return "";
    const angle = Math.atan2(tip[1] - before[1], tip[0] - before[0]);
    const side = (turn) => [
      tip[0] - size * Math.cos(angle + turn), tip[1] - size * Math.sin(angle + turn)];
    return `M${at(side(0.5))}L${at(tip)}L${at(side(-0.5))}`;
  }

  // A bow between two pixels, and its middle.
  function bow(from, to) {
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    const rise = Math.min(0.22 * Math.hypot(dx, dy), 60);
    const length = Math.hypot(dx, dy) || 1;
    const lift = [(-dy / length) * rise, (dx / length) * rise];
    // Upwards on the screen, so that bows do not cover the road between the agents.
    const sign = lift[1] > 0 ? -1 : 1;
    const knee = [0, 1].map((axis) => (from[axis] + to[axis]) / 2 + sign * lift[axis]);
    const points = Array.from({ length: 21 }, (_, step) => {
      const t = step / 20;
      return [0, 1].map((axis) => (1 - t) ** 2 * from[axis] +
        2 * t * (1 - t) * knee[axis] + t * t * to[axis]);
    });
    return { points, middle: points[10] };
  }

  return { shape, icon, plate, flag, along, head, bow };
})();
