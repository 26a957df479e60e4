// Names beside agents: each stands clear of its agent, joined to it by a thin line.
import { make, svg } from "../dom.ts";
import { define, onView, pictureSize } from "../frame.ts";
import { spotBeside } from "../geometry.ts";
import type { Label } from "../messages.ts";
import { circle, taken } from "../shared.ts";

const GAP_PX = 18;

define("labels", (api) => {
  const leaders = svg("svg", "pd-leaders", { "aria-hidden": "true" });
  api.box.append(leaders);
  const plates: ReturnType<typeof newPlate>[] = [];
  let labels: readonly Label[] = [];

  function newPlate() {
    const box = make("div", "pd-label", { role: "note" });
    const [text, note, line] = [make("div"), make("div", "pd-label-note"), svg("line")];
    box.append(text, note);
    api.box.append(box);
    leaders.append(line);
    return { box, text, note, line };
  }

  function place() {
    const placed = [...taken];
    while (plates.length < labels.length) plates.push(newPlate());
    plates.forEach(({ box, text, note, line }, index) => {
      const label = labels[index];
      const seen = label && circle(label.point, label.radius);
      box.style.display = line.style.display = seen ? "" : "none";
      if (!seen) return;
      if (text.textContent !== label.text) text.textContent = label.text;
      if (note.textContent !== label.note) note.textContent = label.note;
      const [reach, size] = [seen.radius * Math.SQRT1_2, { width: box.offsetWidth, height: box.offsetHeight }];
      const spot = spotBeside(seen.at, reach + GAP_PX * Math.SQRT1_2, size, pictureSize(), placed);
      placed.push(spot);
      box.style.transform = `translate(${Math.round(spot.left)}px, ${Math.round(spot.top)}px)`;
      const ends = {
        x1: seen.at[0] + spot.side * reach,
        y1: seen.at[1] + spot.rise * reach,
        x2: spot.side > 0 ? spot.left : spot.left + spot.width,
        y2: spot.rise < 0 ? spot.top + spot.height : spot.top,
      };
      for (const [name, value] of Object.entries(ends)) line.setAttribute(name, String(value));
    });
  }

  onView(place);
  return (state) => {
    labels = state.labels;
    place();
  };
});
