"use strict";
(() => {
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  const one = (id) => document.getElementById(id);
  const parts = document.body.dataset.parts;

  /* Parts of the page are scripts beside it, for a page from disk may read no other files: they call mtpBoard. */
  const pieces = new Map();
  const asked = new Map();
  window.mtpBoard = (key, html) => pieces.set(key, html);
  const load = (file, key) => {
    if (!asked.has(file)) {
      asked.set(file, new Promise((resolve, reject) => {
        const script = document.createElement("script");
        script.src = `${parts}/${encodeURIComponent(file)}.js`;
        script.onload = resolve;
        script.onerror = reject;
        document.head.append(script);
      }));
    }
    return asked.get(file).then(() => pieces.get(key) ?? missing);
  };
  const missing = `<p class="note">This part is missing: the folder ${parts} belongs beside the page.</p>`;

  /* Details of an entry. */
  const detailOf = (entry) => {
    const row = document.createElement("tr");
    row.className = "detail";
    row.append(document.createElement("td"));
    row.firstChild.colSpan = entry.rows[0].cells.length;
    entry.append(row);
    load(entry.closest(".board").dataset.env, entry.id).catch(() => missing).then((html) => { row.firstChild.innerHTML = html; });
    return row;
  };
  const setOpen = (entry, open) => {
    if (open || entry.rows[1]) (entry.rows[1] ?? detailOf(entry)).hidden = !open;
    entry.querySelector(".open").setAttribute("aria-expanded", String(open));
  };
  const isOpen = (entry) => entry.querySelector(".open").getAttribute("aria-expanded") === "true";

  const number = (table) => all("tbody.entry", table).forEach((entry, i) => { entry.dataset.order = i; });

  /* Entries without a value stay last in both directions; equal values keep the order of the ranking. */
  const valueOf = (entry, kind, column) => {
    if (kind === "level") return Number(entry.dataset.level);
    const cell = entry.rows[0].cells[column];
    if (entry.classList.contains("part")) return NaN;  // a partial record stands behind whole ones
    if (kind === "name") return cell.querySelector(".open").textContent;
    return parseFloat(cell.textContent.replace("−", "-"));
  };
  const sortBy = (table, kind, column, descending) => {
    const keyed = all("tbody.entry", table).map((entry) => [valueOf(entry, kind, column), entry]);
    keyed.sort(([a, left], [b, right]) => {
      if (Number.isNaN(a) !== Number.isNaN(b)) return Number.isNaN(a) ? 1 : -1;
      const difference = a < b ? -1 : a > b ? 1 : 0;
      return (descending ? -difference : difference) || left.dataset.order - right.dataset.order;
    });
    keyed.forEach(([, entry]) => table.append(entry));
    for (const heading of all("tbody.heading", table)) table.querySelector(`tbody.${heading.dataset.of}`).before(heading);
  };
  const onHeader = (button) => {
    const header = button.closest("th");
    const table = button.closest("table");
    const first = button.dataset.better === "higher" ? "descending" : "ascending";
    const second = first === "ascending" ? "descending" : "ascending";
    const next = header.getAttribute("aria-sort") === first ? second : first;
    all("th[aria-sort]", table).forEach((other) => other.removeAttribute("aria-sort"));
    header.setAttribute("aria-sort", next);
    sortBy(table, button.dataset.sort, header.cellIndex, next === "descending");
  };

  /* Filters, kept in the address after the place: #env/submission?text=...&level=2 */
  const filters = ["text", "env", "level"];
  const form = one("_filters");
  let target = "";
  const remember = () => {
    const query = new URLSearchParams(filters.map((name) => [name, one(`_${name}`).value]).filter(([, value]) => value));
    if (!one("_unranked").checked) query.set("unranked", "no");
    const hash = `${target}${query.size ? "?" : ""}${query}`;
    history.replaceState(null, "", hash ? `#${hash}` : location.pathname + location.search);
  };
  const passes = (entry, words, level, unranked) => {
    const authors = entry.dataset.authors ?? entry.querySelector(".by bdi").textContent;  // all, or those of a short line
    const text = `${entry.querySelector(".open").textContent} ${authors}`.toLowerCase();
    return (level === "" || Number(entry.dataset.level) >= Number(level)) &&
      (unranked || !entry.classList.contains("unranked")) &&
      words.every((word) => text.includes(word));
  };
  const filter = () => {
    const [text, env, level] = filters.map((name) => one(`_${name}`).value);
    const words = text.toLowerCase().split(/\s+/).filter(Boolean);
    const unranked = one("_unranked").checked;
    let [shown, total] = [0, 0];
    for (const board of all(".board")) {
      const entries = all("tbody.entry", board);
      for (const entry of entries) entry.hidden = !passes(entry, words, level, unranked);
      const kept = entries.filter((entry) => !entry.hidden).length;
      board.hidden = env !== "" && board.dataset.env !== env;
      total += entries.length;
      if (!board.hidden) shown += kept;
      board.querySelector(".none").hidden = kept > 0;
      board.querySelector(".scroll").hidden = kept === 0;
    }
    const noun = total === 1 ? "entry" : "entries";
    one("_count").textContent = shown === total ? `${total} ${noun}` : `${shown} of ${total} ${noun}`;
  };

  /* The address: opens an entry, shows a table, sets the filters. */
  const goTo = () => {
    const [place, query] = location.hash.slice(1).split("?");
    if (place.startsWith("_")) return;
    target = place;
    const wanted = new URLSearchParams(query ?? "");
    if (form) {
      for (const name of filters) one(`_${name}`).value = wanted.get(name) ?? "";
      one("_unranked").checked = wanted.get("unranked") !== "no";
      filter();
    }
    const board = one(place.split("/")[0]);
    if (!board || !place) return;
    board.hidden = false;
    const found = one(place);
    if (found?.matches("tbody.entry")) {
      found.hidden = false;
      board.querySelector(".scroll").hidden = false;
      board.querySelector(".none").hidden = true;
      setOpen(found, true);
      found.querySelector(".open").focus({ preventScroll: true });
    }
    (found ?? board).scrollIntoView();
  };

  /* The explanation of a column, below the heading that has the pointer or the focus; the pointer may go to it, and
     Escape takes it away. */
  const tip = one("_tip");
  let described = null;
  const place = () => {
    if (tip.hidden) return;
    const box = described.closest("th").getBoundingClientRect();
    const left = Math.max(8, Math.min(box.left, document.documentElement.clientWidth - tip.offsetWidth - 8));
    const below = box.bottom + tip.offsetHeight < window.innerHeight;
    tip.style.left = `${left}px`;
    tip.style.top = `${below ? box.bottom : box.top - tip.offsetHeight}px`;
  };
  const explain = (event) => {
    if (tip.contains(event.target)) return;
    described = event.target.closest?.("thead th")?.querySelector("[aria-describedby]");
    const text = described && one(described.getAttribute("aria-describedby"))?.textContent;
    tip.hidden = !text;
    tip.textContent = text ?? "";
    place();
  };
  for (const kind of ["pointerover", "focusin"]) document.addEventListener(kind, explain);
  document.addEventListener("focusout", () => { tip.hidden = true; });
  document.addEventListener("scroll", place, { capture: true, passive: true });
  document.addEventListener("keydown", (event) => { if (event.key === "Escape") tip.hidden = true; });

  document.addEventListener("click", (event) => {
    const link = event.target.closest("a[href^='#']");
    if (link && link.hash === location.hash && !link.hash.startsWith("#_")) goTo();
    const button = event.target.closest("button");
    const entry = event.target.closest("tbody.entry");
    if (!button) return;
    if (button.matches(".open")) {
      setOpen(entry, !isOpen(entry));
      target = isOpen(entry) ? entry.id : entry.closest(".board").id;
      remember();
    } else if (button.dataset.sort) onHeader(button);
  });
  for (const table of all("table.ranking")) number(table);
  if (form) {
    form.hidden = false;
    form.addEventListener("input", () => { remember(); filter(); });
    form.addEventListener("submit", (event) => event.preventDefault());
  }
  window.addEventListener("hashchange", goTo);
  goTo();
})();
