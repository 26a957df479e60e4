// The page itself: its title, its theme, what a browser would do with our keys, and what
// this version of viser's page lacks.
import { missing, openCommands } from "../bridge.ts";
import { hasModifier, isTyping, make, recall, remember, within } from "../dom.ts";
import { define, hearFirst, isOnPicture, listen, onDispose, root, take } from "../frame.ts";

/** viser has built its page by then, unless the browser is busy. */
const BUILT_MS = 20_000;

define("page", (api) => {
  listen(document, "keydown", (event) => {
    // Ctrl+A would mark the page's text; the editor selects all agents by it.
    const isAsked = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "a";
    if (isAsked && !isTyping(event)) event.preventDefault();
  });
  // viser opens its list of commands by Ctrl+K unless a text field has the focus: what is
  // typed next would go into that field. So the field gives the focus away first.
  hearFirst("keydown", (event) => {
    const isAsked = hasModifier(event) && !event.shiftKey && !event.altKey;
    if (!isAsked || event.key.toLowerCase() !== "k" || !event.isTrusted) return;
    if (!isTyping(event) || within(event, "[role=dialog]")) return;
    take(event);
    (event.target as HTMLElement).blur();
    openCommands(event);
  });
  // Behind an open dialog nothing can be used: Tab goes round within it.
  hearFirst("keydown", (event) => {
    const dialog = event.key === "Tab" && root.querySelector(".pd-veil:not([hidden]) > [role=dialog]");
    if (!dialog) return;
    const all = [...dialog.querySelectorAll<HTMLElement>("button, input, select, [tabindex='0']")];
    const at = all.indexOf(document.activeElement as HTMLElement) + (event.shiftKey ? -1 : 1);
    take(event);
    all.at(event.shiftKey && at < -1 ? -1 : at % all.length)?.focus();
  });
  // viser calls preventDefault for a press on an agent in a passive listener, where it has
  // no effect but an error in the console.
  listen(
    document,
    "pointerdown",
    (event) => {
      if (isOnPicture(event)) event.preventDefault = () => {};
    },
    { capture: true },
  );

  const lack = make("div", "pd-solid pd-banner-bar pd-lack-bar", { role: "alert" });
  lack.hidden = true;
  api.box.append(lack);
  // Told when it was so twice: a busy browser builds its page late.
  let before: readonly string[] = [];
  const watch = setInterval(() => {
    const names = missing();
    lack.hidden = !names.length || !before.length;
    lack.textContent = `This version of viser lacks what the editor needs for: ${names.join(", ")}.`;
    if (!names.length) clearInterval(watch);
    else if (before.length) {
      clearInterval(watch);
      api.send({ kind: "missing", names });
    }
    before = names;
  }, BUILT_MS);
  onDispose(() => clearInterval(watch));

  return ({ title, isDark }) => {
    document.title = title;
    root.classList.toggle("pd-dark", isDark);
    // Of what we put into viser's panel.
    document.documentElement.classList.toggle("pd-dark-page", isDark);
  };
});

// The theme is the browser's until the user chooses one, which the browser remembers.
define("theme", (api) => {
  const KEPT = "pd-editor-dark";
  const browsers = window.matchMedia("(prefers-color-scheme: dark)");
  const tell = () => {
    const kept = recall(KEPT);
    api.send({ isDark: typeof kept === "boolean" ? kept : browsers.matches });
  };
  listen(browsers, "change", tell);
  tell();
  return ({ isDark }) => remember(KEPT, isDark);
});
