"use strict";
(() => {
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  const one = (id) => document.getElementById(id);

  const setOpen = (entry, open) => {
    entry.querySelector(".detail").hidden = !open;
    entry.querySelector(".open").setAttribute("aria-expanded", String(open));
  };

  /* Entries without a value stay last in both directions; equal values keep the order of the ranking. */
  const sortBy = (table, key, descending) => {
    const entries = all("tbody.entry", table);
    const value = (entry) => entry.querySelector(`[data-key="${key}"]`).dataset.value;
    const keyed = entries.map((entry) => [value(entry), entry]);
    const textual = key === "name";
    keyed.sort(([a, left], [b, right]) => {
      if ((a === "") !== (b === "")) return a === "" ? 1 : -1;
      const difference = textual ? (a < b ? -1 : a > b ? 1 : 0) : Number(a) - Number(b);
      return (descending ? -difference : difference) || left.dataset.order - right.dataset.order;
    });
    keyed.forEach(([, entry]) => table.append(entry));
  };

  const onHeader = (button) => {
    const header = button.closest("th");
    const table = button.closest("table");
    const now = header.getAttribute("aria-sort");
    const first = button.dataset.better === "higher" ? "descending" : "ascending";
    const second = first === "ascending" ? "descending" : "ascending";
    const next = now === first ? second : first;
    all("th[aria-sort]", table).forEach((other) => other.removeAttribute("aria-sort"));
    header.setAttribute("aria-sort", next);
    sortBy(table, button.dataset.key, next === "descending");
  };

  const filter = () => {
    const words = one("text").value.toLowerCase().split(/\s+/).filter(Boolean);
    const [env, division, level] = ["env", "division", "level"].map((id) => one(id).value);
    const unranked = one("unranked").checked;
    let shown = 0;
    for (const board of all(".board")) {
      const entries = all("tbody.entry", board);
      board.hidden = env !== "" && board.dataset.env !== env;
      for (const entry of entries) {
        const data = entry.dataset;
        entry.hidden = !(
          (division === "" || data.division === division) &&
          (level === "" || Number(data.level) >= Number(level)) &&
          (unranked || data.ranked === "1") &&
          words.every((word) => data.text.includes(word))
        );
        if (!entry.hidden && !board.hidden) shown += 1;
      }
      const none = entries.every((entry) => entry.hidden);
      board.querySelector(".none").hidden = !none;
      board.querySelector(".scroll").hidden = none;
    }
    const total = all("tbody.entry").length;
    const noun = total === 1 ? "entry" : "entries";
    one("count").textContent = shown === total ? `${total} ${noun}` : `${shown} of ${total} ${noun}`;
  };

  for (const table of all("table.ranking")) {
    all("tbody.entry", table).forEach((entry, i) => {
      entry.dataset.order = i;
      setOpen(entry, false);
    });
  }
  document.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (!button) return;
    const entry = button.closest("tbody.entry");
    if (entry) setOpen(entry, entry.querySelector(".detail").hidden);
    else if (button.dataset.key) onHeader(button);
  });
  const form = one("filters");
  if (form) {
    form.hidden = false;
    form.addEventListener("input", filter);
    form.addEventListener("submit", (event) => event.preventDefault());
    filter();
  }
})();
