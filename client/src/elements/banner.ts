// One line at the top centre: the mode that the editor is in, and a button that ends it.
import { button, make } from "../dom.ts";
import { define } from "../frame.ts";

define("banner", (api) => {
  const bar = make("div", "pd-solid pd-banner-bar", { role: "status", "aria-live": "polite", "aria-label": "Mode" });
  const words = make("span", "pd-banner-text");
  const end = button("", "", () => api.send({ owner }));
  bar.append(words, end);
  api.box.append(bar);
  bar.hidden = true;
  let owner: string | null = null;
  return (state) => {
    owner = state.owner;
    bar.hidden = owner === null;
    words.textContent = state.text;
    end.hidden = state.button === null;
    end.textContent = state.button ?? "";
  };
});
