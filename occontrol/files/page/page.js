"use strict";
(() => {
  const find = (root, what) => [...root.querySelectorAll(what)];
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const printing = window.matchMedia("print");
  const read = (id) => JSON.parse(document.getElementById(id).textContent);

  // ---- panels

  const models = () => Bokeh.documents.flatMap((d) => d.roots().flatMap((r) => [...r.references()]));

  // ink, soft ink, lines, paper: as they stand in the data, and on the dark page
  const DAY = ["#1b1e23", "#555b64", "#d5d8dc", "#ffffff"], NIGHT = ["#e6e8eb", "#a9b0b9", "#3a4048", "#15181c"];
  const night = () => dark.matches && !printing.matches;

  // before drawing: what changes afterwards is laid out twice
  const dyed = (text) => (night() ? DAY.reduce((all, day, i) => all.replaceAll(`"${day}"`, `"${NIGHT[i]}"`), text) : text);

  function paint() {
    const [ink, soft, line, paper] = night() ? NIGHT : DAY;
    const looks = {
      LinearAxis: { axis_label_text_color: ink, major_label_text_color: soft, axis_line_color: soft,
        major_tick_line_color: soft },
      Title: { text_color: ink },
      Legend: { label_text_color: ink, inactive_fill_color: paper },
      ColorBar: { title_text_color: ink, major_label_text_color: soft },
      Grid: { grid_line_color: line },
    };
    looks.LogAxis = looks.LinearAxis;
    for (const model of models()) {
      const look = looks[model.type];
      if (look) model.setv(look);
    }
  }

  async function draw() {
    for (const place of find(document, ".panels")) {
      if (!window.Bokeh) { place.remove(); continue; }
      await Bokeh.embed.embed_item(JSON.parse(dyed(document.getElementById(place.id + "-data").textContent)));
    }
    dark.addEventListener("change", paint);
    window.addEventListener("beforeprint", paint);
    window.addEventListener("afterprint", paint);
  }

  // a sensor that is not ticked is hidden in every panel
  function show() {
    const boxes = find(document, ".sensors input");
    const hidden = new Set(boxes.filter((b) => !b.checked).map((b) => b.value));
    const rows = new Set(boxes.map((b, i) => (b.checked ? -1 : i)));
    const Filter = Bokeh.Models.get("BooleanFilter");
    for (const model of models()) {
      if (model.type !== "GlyphRenderer" || !model.name) continue;
      if (model.name === "schedule") {
        const row = Array.from(model.data_source.data.row);
        model.view.filter = new Filter({ booleans: row.map((j) => !rows.has(j)) });
      } else if (model.name.startsWith("sensor:")) {
        model.visible = !hidden.has(model.name.slice(7));
      }
    }
  }

  // ---- tables

  const STEP = 200;
  const cell = (column, i) => (column.words ? column.words[column.codes[i]] : column.values[i]);
  const text = (value) => (value === null || value === undefined ? "" : String(value));

  function table(section) {
    const content = read(section.dataset.table);
    const { headings, columns, length } = content;
    for (const column of columns) {
      if (column.after !== undefined) column.values = [...columns[column.after].values.slice(1), column.last];
    }
    const body = section.querySelector("tbody"), more = section.querySelector(".next"), count = section.querySelector(".more");
    let order = Array.from({ length }, (_, i) => i), shown = 0, by = -1, down = false;

    function add(many) {
      const part = document.createDocumentFragment(), end = Math.min(length, shown + many);
      for (; shown < end; shown++) {
        const row = document.createElement("tr");
        for (const column of columns) {
          const field = document.createElement("td");
          field.textContent = text(cell(column, order[shown]));
          if (!column.words) field.className = "number";
          row.append(field);
        }
        part.append(row);
      }
      body.append(part);
      more.hidden = shown >= length;
      count.textContent = shown < length ? `${shown} of ${length} rows` : `${length} rows`;
    }
    function again() { body.replaceChildren(); shown = 0; add(STEP); }

    find(section, "th button").forEach((button, c) => button.addEventListener("click", () => {
      down = by === c && !down;
      by = c;
      const column = columns[c];
      const less = column.words
        ? (a, b) => cell(column, a).localeCompare(cell(column, b), undefined, { numeric: true })
        : (a, b) => (column.values[a] ?? Infinity) - (column.values[b] ?? Infinity);
      order.sort((a, b) => (down ? less(b, a) : less(a, b)) || a - b);
      find(section, "th").forEach((th, i) =>
        i === c ? th.setAttribute("aria-sort", down ? "descending" : "ascending") : th.removeAttribute("aria-sort"));
      again();
    }));
    more.addEventListener("click", () => add(STEP));

    function csv() {
      const quoted = (value) => (/[",\n]/.test(value) ? `"${value.replaceAll('"', '""')}"` : value);
      const lines = order.map((i) => columns.map((column) => quoted(text(cell(column, i)))).join(","));
      return [headings.map(quoted).join(","), ...lines].join("\n") + "\n";
    }
    section.querySelector(".copy").addEventListener("click", async (event) => {
      const area = document.createElement("textarea");
      area.value = csv();
      try {
        await navigator.clipboard.writeText(area.value);
      } catch {  // a page that was opened as a file may not be trusted with it
        document.body.append(area);
        area.select();
        document.execCommand("copy");
        area.remove();
      }
      event.target.textContent = "copied";
      setTimeout(() => { event.target.textContent = "copy as CSV"; }, 2000);
    });
    section.csv = csv;
    again();
  }

  find(document, "section[data-table]").forEach(table);
  find(document, ".sensors input").forEach((b) => b.addEventListener("change", show));
  window.drawn = draw();
})();
