// The bar at the bottom: whom Regenerate and Resample are about, how many samples, which
// seed, how a run goes, and how the last one went.
import { button, make, option } from "../dom.ts";
import { define } from "../frame.ts";
import { clamp } from "../geometry.ts";

define("run", (api) => {
  const bar = make("div", "pd-solid pd-run", { role: "group", "aria-label": "Run" });
  const verbs = (["regenerate", "resample"] as const).map((kind) =>
    button(`pd-run-${kind}`, "", () => api.send({ kind })),
  );
  const scope = make("select", "", { "aria-label": "Agents to regenerate", title: "Whom to regenerate" });
  scope.addEventListener("change", () => api.send({ kind: "scope", value: scope.value }));
  const numbers = (["samples", "seed"] as const).map((kind) => {
    const name = { samples: "Samples", seed: "Seed" }[kind];
    const field = make("input", "", { type: "number", name: kind, "aria-label": name });
    field.addEventListener("change", () => {
      field.value = String(clamp(Math.round(field.valueAsNumber || 0), Number(field.min), Number(field.max)));
      api.send({ kind, value: Number(field.value) });
    });
    return { kind, field, label: make("label", "", {}, name) };
  });
  for (const { field, label } of numbers) label.append(field);
  const text = make("span", "pd-run-said", { role: "status", "aria-label": "Last run" });
  const use = button("pd-strong", "", () => api.send({ kind: "use" }));
  const cancel = button("pd-strong", "Cancel", () => api.send({ kind: "cancel" }));
  const progress = make("div", "pd-progress", {
    role: "progressbar",
    "aria-label": "Progress",
    "aria-valuemin": "0",
    "aria-valuemax": "100",
  });
  const end = make("div", "pd-run-end", { tabindex: 0 });
  end.append(text, use, cancel);
  bar.append(verbs[0], scope, verbs[1], ...numbers.map((one) => one.label), end, progress);
  api.box.append(bar);

  return (state) => {
    for (const [index, { label, target, isEnabled }] of state.verbs.entries()) {
      // The verb is cut before whom it is about.
      verbs[index].replaceChildren(make("span", "", {}, `${label} `), make("b", "", {}, target));
      verbs[index].title = `${label} ${target} (${index ? "settings in the tab Generate" : "R"})`;
      verbs[index].disabled = !isEnabled;
    }
    if (!scope.length) scope.append(...state.scopes.map((one) => option(one, one)));
    scope.value = state.scope;
    for (const { kind, field } of numbers) {
      [field.min, field.max] = state.limits[kind].map(String);
      // What is being typed stays.
      if (document.activeElement !== field) field.value = String(state[kind]);
    }
    if (text.textContent !== state.text) text.textContent = state.text;
    end.toggleAttribute("data-hint", Boolean(state.text));
    if (state.text) end.dataset.hint = state.text;
    bar.dataset.tone = state.tone;
    use.hidden = !state.action;
    use.textContent = state.action;
    cancel.hidden = progress.hidden = state.fraction === null;
    const percent = 100 * (state.fraction ?? 0);
    progress.style.width = `${percent}%`;
    progress.setAttribute("aria-valuenow", String(Math.round(percent)));
  };
});
