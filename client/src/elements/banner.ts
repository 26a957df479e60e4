// One line at the top centre: the mode that the editor is in, and buttons that end it.
import { button, make } from "../dom.ts";
import { define } from "../frame.ts";

define("banner", (api) => {
  const bar = make("div", "pd-solid pd-banner-bar", { role: "status", "aria-live": "polite", "aria-label": "Mode" });
  const words = make("span", "pd-banner-text");
  bar.append(words);
  api.box.append(bar);
  bar.hidden = true;
  let owner: string | null = null;
  let names = "";
  return (state) => {
    owner = state.owner;
    bar.hidden = owner === null;
    words.textContent = state.text;
    // A button that stays is the same element, so that a press on it is not lost.
    if (names === state.buttons.join()) return;
    names = state.buttons.join();
    bar.replaceChildren(
      words,
      ...state.buttons.map((name) => button("", name, () => api.send({ owner, button: name }))),
    );
  };
});
