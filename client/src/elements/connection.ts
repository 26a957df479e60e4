// A lost connection: the picture and the controls stay, but nothing answers any more.
import { canvas, connection } from "../bridge.ts";
import { make } from "../dom.ts";
import { define, heardAt, keepPicture, lostPicture, onDispose, picture, root } from "../frame.ts";
import { copyOf } from "../shared.ts";

const TOLD_MS = 6000;
const ASKS_MS = 2000;
const WATCH_MS = 250;
const FORBIDDEN = 403;

define("connection", (api) => {
  const bar = make("div", "pd-solid pd-banner-bar pd-connection-bar", { role: "alert" });
  const words = make("span", "pd-banner-text");
  bar.append(words);
  bar.hidden = true;
  api.box.append(bar);
  const mine = connection();

  // A server that was started anew has another token, with which nothing connects again.
  async function ask(saved: string): Promise<void> {
    const request = new AbortController();
    onDispose(() => request.abort());
    const answer = await fetch(location.href, { cache: "no-store", signal: request.signal }).catch(() => null);
    request.abort();
    if (answer?.status === FORBIDDEN)
      words.textContent = `The editor was started anew, with another address: open the one that it printed. ${saved}`;
    else
      setTimeout(() => {
        if (picture()) ask(saved);
      }, ASKS_MS);
  }
  function lose() {
    const source = canvas();
    const isUnsaved = root.querySelector(".pd-unsaved:not([hidden])");
    const saved = isUnsaved
      ? "The newest edits are not saved."
      : `Edits up to ${heardAt().toLocaleTimeString()} are saved.`;
    words.textContent = `Connection lost. ${saved} Reconnecting \u2026`;
    bar.classList.remove("pd-good");
    bar.hidden = false;
    root.classList.add("pd-lost");
    // viser empties its picture when it is connected again.
    const still = make("canvas", "pd-still");
    if (source) {
      copyOf(source, still);
      // As large as it is now: the panel beside it goes for a moment.
      still.style.width = `${source.clientWidth}px`;
      still.style.height = `${source.clientHeight}px`;
    }
    api.box.prepend(still);
    keepPicture(still);
    ask(saved);
  }
  const watch = setInterval(() => {
    if (connection() !== mine && !picture()) lose();
  }, WATCH_MS);
  onDispose(() => clearInterval(watch));

  return ({ isNew }) => {
    if (!lostPicture) return;
    words.textContent = isNew
      ? "Connected to a server that was started anew. Your edits are under \u201cUnfinished\u201d (N)."
      : "Connected again. All edits are here.";
    bar.classList.add("pd-good");
    bar.hidden = false;
    setTimeout(() => {
      bar.hidden = bar.classList.contains("pd-good");
    }, TOLD_MS);
  };
});
