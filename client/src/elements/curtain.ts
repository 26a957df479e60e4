// Another scenario comes as a whole: the former picture stays until the new road is
// there. The camera and the agents of the page change at once, while it takes a few
// frames to read the meshes of a road; in between it would show one with the other.
// A page that is connected again shows the picture from before the loss in the same way.
import { canvas, hasMessages, meshOf, requestRender } from "../bridge.ts";
import { make } from "../dom.ts";
import { define, lostPicture } from "../frame.ts";
import { copyOf } from "../shared.ts";

const LONGEST_MS = 2000;
// A layer that is as it was, or has nothing in it, never changes. It is not waited
// for once the others have come, or once so much time and so many frames have gone.
const REST = { ms: 120, frames: 3 };
const NOTHING = { ms: 300, frames: 4 };

define("curtain", (api) => {
  const still = make("canvas", "pd-still pd-gone");
  api.box.append(still);
  let number = 0;
  if (lostPicture) raise(lostPicture);

  function raise(source: HTMLCanvasElement) {
    // Still up for the scenario before: what is under it may be half of either.
    if (!still.classList.contains("pd-gone")) return;
    copyOf(source, still);
    still.classList.remove("pd-gone");
  }

  return ({ nodes }) => {
    number += 1;
    const source = number > 1 ? canvas() : lostPicture;
    if (!source || document.hidden) {
      still.classList.add("pd-gone");
      return;
    }
    const mine = number;
    const start = performance.now();
    const former = nodes.map(meshOf);
    const changed = new Set<string>();
    let quietSince = start;
    let quietFrames = 0;
    raise(source);
    function look() {
      if (mine !== number) return;
      const now = performance.now();
      quietFrames += 1;
      nodes.forEach((name, index) => {
        const mesh = meshOf(name);
        if (changed.has(name) || !mesh || mesh === former[index]) return;
        changed.add(name);
        quietSince = now;
        quietFrames = 0;
      });
      const patience = changed.size > 0 ? REST : NOTHING;
      const isQuiet = now - quietSince > patience.ms && quietFrames > patience.frames && !hasMessages();
      const isThere = changed.size === nodes.length || isQuiet;
      if (!isThere && now - start < LONGEST_MS) {
        requestAnimationFrame(look);
        return;
      }
      requestRender();
      requestAnimationFrame(() =>
        requestAnimationFrame(() => {
          if (mine === number) still.classList.add("pd-gone");
        }),
      );
    }
    requestAnimationFrame(look);
  };
});
