"use strict";
// Drawings of a campaign's page, from the JSON in #data. No text becomes markup: textContent here, plain() in plots.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const config = {displaylogo: false, responsive: true, showSendToCloud: false, plotlyServerURL: "",
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"]};
  const $ = (id) => document.getElementById(id);
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const LINES = ["accent", "predicted", "CD", "ID", "FA", "residual"];

  const axis = (more) => ({gridcolor: colour("line"), zerolinecolor: colour("line"), linecolor: colour("line"),
    ticks: "outside", tickcolor: colour("line"), automargin: true, ...more});
  const layout = (more) => ({
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: {color: colour("ink"), size: 12, family: getComputedStyle(document.body).fontFamily},
    modebar: {bgcolor: "rgba(0,0,0,0)", color: colour("line"), activecolor: colour("accent")},
    hoverlabel: {font: {size: 12}}, margin: {l: 55, r: 20, t: 35, b: 45}, showlegend: false, ...more});

  // Times to detect: one row a condition over one logarithmic axis, what was missed beyond its end.
  function histogram() {
    const {edges, rows} = data.histogram, room = $("histogram"), step = edges[1] - edges[0];
    const middles = edges.slice(1).map((edge) => edge - step / 2), never = edges.at(-1) + 3 * step;
    const missing = rows.some((row) => row.missed), height = 1 / rows.length, traces = [], notes = [], look = {};
    rows.forEach((row, k) => {
      const y = k ? `y${k + 1}` : "y", top = 1 - k * height, most = Math.max(1, row.missed, ...row.counts);
      look[`yaxis${k ? k + 1 : ""}`] = axis({domain: [top - height * 0.88, top - height * 0.2],
        range: [-0.28 * most, 1.08 * most], tickvals: [0, most], zeroline: true});
      traces.push({type: "bar", x: middles, y: row.counts, yaxis: y, width: step * 0.94,
        marker: {color: colour("accent")},
        customdata: row.counts.map((_, i) => [10 ** edges[i], 10 ** edges[i + 1]]),
        hovertemplate: "%{customdata[0]:.3g} to %{customdata[1]:.3g} s: %{y}<extra></extra>"});
      traces.push({type: "bar", x: [never], y: [row.missed], yaxis: y, width: step * 1.6,
        marker: {color: colour("MD")}, hovertemplate: "missed: %{y}<extra></extra>"});
      traces.push({type: "scatter", mode: "markers", x: row.td.map((td) => Math.log10(Math.max(td, 0.001))),
        y: row.td.map(() => -0.14 * most), yaxis: y, customdata: row.trials, text: row.td.map((td) => td.toFixed(3)),
        marker: {symbol: "line-ns-open", size: 9, color: colour("ink"), opacity: 0.55},
        hovertemplate: "%{text} s, trial %{customdata}<extra></extra>"});
      notes.push({x: 0, y: top - height * 0.18, xref: "paper", yref: "paper", xanchor: "left", yanchor: "bottom",
        showarrow: false, align: "left",
        text: `<b>${plain(row.key)}</b>  <span style="color:${colour("faint")}">${plain(row.note)}</span>`});
    });
    const ticks = [];
    for (let power = Math.floor(edges[0]); power <= edges.at(-1) + 1e-9; power++)
      for (const digit of [1, 2, 5]) {
        const at = Math.log10(digit) + power;
        if (at > edges[0] - 1e-9 && at < edges.at(-1) + 1e-9) ticks.push(at);
      }
    const name = `y${rows.length > 1 ? rows.length : ""}`;
    room.style.height = "auto";
    Plotly.react(room, traces, layout({...look, annotations: notes, bargap: 0, height: 108 * rows.length + 50,
      margin: {l: 45, r: 15, t: 5, b: 45},
      xaxis: axis({range: [edges[0], missing ? never + 2 * step : edges.at(-1)], anchor: name,
        tickvals: [...ticks, ...(missing ? [never] : [])],
        ticktext: [...ticks.map((at) => `${+(10 ** at).toPrecision(2)}`), "missed"],
        title: {text: "time to detect, s (logarithmic)"}})}), config);
    if (!room.wired) room.on("plotly_click", (event) => {
      const id = event.points.map((point) => point.customdata).find((id) => typeof id === "string");
      if (id) { pick(id); $("freeze").scrollIntoView({behavior: "smooth", block: "nearest"}); }
    });
    room.wired = true;
  }

  // A figure of the caller's own, in this page's colours.
  function figure({data, layout: own}, room) {
    const template = {layout: {...layout({}), xaxis: axis({}), yaxis: axis({})}};
    const clear = {paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)"};
    Plotly.react(room, data, {...own, template, ...clear}, config);
  }

  // Curves with their intervals: lines {name, x, y, low, high, text}, levels and marks as dashed lines.
  function curves(plot, room) {
    const traces = [];
    plot.lines.forEach((line, k) => {
      const paint = colour(LINES[k % LINES.length]);
      const error = line.low && {type: "data", symmetric: false, thickness: 1.2, width: 4, color: paint,
        array: line.high.map((high, i) => high - line.y[i]), arrayminus: line.low.map((low, i) => line.y[i] - low)};
      traces.push({type: "scatter", mode: line.low ? "lines+markers" : "lines", name: plain(line.name), x: line.x,
        y: line.y, error_y: error, text: line.text, line: {color: paint, width: 1.8}, marker: {size: 6},
        hovertemplate: `%{x}: %{y:.4g}${line.text ? ", %{text}" : ""}<extra></extra>`});
    });
    const dashed = {type: "line", layer: "below", line: {color: colour("faint"), width: 1, dash: "dot"}};
    const level = (y) => ({...dashed, xref: "paper", x0: 0, x1: 1, y0: y, y1: y});
    const mark = (at) => ({...dashed, yref: "paper", y0: 0, y1: 1, x0: at.x, x1: at.x});
    Plotly.react(room, traces, layout({
      title: {text: plain(plot.title), font: {size: 13}, x: 0.02, xanchor: "left"},
      height: 330, margin: {l: 55, r: 20, t: 60, b: 45},
      xaxis: axis({title: {text: plain(plot.x)}, ...plot.xaxis}),
      yaxis: axis({title: {text: plain(plot.y)}, ...plot.yaxis}),
      shapes: [...(plot.levels || []).map(level), ...(plot.marks || []).map(mark)],
      annotations: (plot.marks || []).map((at) => ({x: at.x, y: 1, yref: "paper", yanchor: "bottom",
        showarrow: false, text: plain(at.text), font: {size: 11, color: colour("faint")}})),
      showlegend: plot.lines.length > 1, legend: {orientation: "h", y: -0.25}}), config);
  }

  const CHANNELS = [["measured", "mm", "y", 2.4], ["predicted", "mm", "y", 1.4], ["residual", "%", "y2", 1]];

  // Differences of hundredths, null where there is no value.
  function values(steps) {
    let sum = 0;
    return steps.map((step) => (step === null ? null : (sum += step) / 100));
  }

  function freeze(trial) {
    const room = $("wave"), both = trial.sides.length > 1, traces = [], marks = [];
    const [before, after] = trial.sides.map((side) => side.frame);
    const same = (name) => before && after && before.t0 === after.t0  // in both: it is drawn once
      && String(before.series[name]) === String(after.series[name]);
    trial.sides.forEach((side, k) => {
      const suffix = both ? `, ${plain(side.name)}` : "", dash = both && !k ? "dot" : "solid";
      for (const name of Object.keys(side.instants)) {
        const x = side.instants[name];
        const same = marks.find((mark) => mark.name === name && mark.x === x);
        if (same) same.label = name; else marks.push({name, x, dash, label: name + suffix});
      }
      if (!side.frame) return;
      const {t0, dt, series} = side.frame;
      for (const [name, unit, y, width] of CHANNELS) {
        if (same(name) && !k) continue;
        traces.push({type: "scatter", mode: "lines", name: name + (same(name) ? "" : suffix), yaxis: y,
          x: series[name].map((_, i) => t0 + i * dt), y: values(series[name]),
          line: {width, color: colour(name), dash},
          hovertemplate: `%{y:.2f} ${unit}<extra>${name}${suffix}</extra>`});
      }
    });
    room.classList.toggle("none", !traces.length);
    if (!traces.length) {
      if (room.drawn) Plotly.purge(room);
      room.drawn = false;
      room.textContent = "There is no freeze frame of this trial here.";
      return;
    }
    if (!room.drawn) room.textContent = "";
    const from = Math.min(...traces.map((trace) => trace.x[0])), to = Math.max(...traces.map((t) => t.x.at(-1)));
    const seen = marks.filter((mark) => mark.x >= from && mark.x <= to).sort((a, b) => a.x - b.x);
    const ends = [];  // of the labels in each level: labels of instants close together stand above each other
    const labels = seen.map((mark) => {
      const width = (to - from) * 0.0125 * (mark.label.length + 1);
      let level = ends.findIndex((end) => end < mark.x - width / 2);
      if (level < 0) level = ends.length;
      ends[level] = mark.x + width / 2;
      return {x: mark.x, y: 1, yref: "paper", yanchor: "bottom", yshift: 14 * level, showarrow: false,
        text: mark.label, font: {size: 11, color: colour(mark.name === "t_alarm" ? "FA" : "ink")}};
    });
    const shapes = seen.map((mark) => ({type: "line", x0: mark.x, x1: mark.x, yref: "paper", y0: 0, y1: 1,
      line: {width: 1, dash: mark.dash === "dot" ? "dot" : "dash",
        color: colour(mark.name === "t_alarm" ? "FA" : "faint")}}));
    const last = trial.sides.at(-1).instants;
    if (last.t_active !== undefined && last.t_alarm > last.t_active)
      shapes.push({type: "rect", layer: "below", x0: last.t_active, x1: last.t_alarm, yref: "paper", y0: 0, y1: 1,
        fillcolor: colour("span"), line: {width: 0}});
    Plotly.react(room, traces, layout({height: 460, hovermode: "x unified", shapes, annotations: labels,
      margin: {l: 55, r: 15, t: 12 + 14 * Math.max(1, ends.length), b: both ? 95 : 75},
      xaxis: axis({title: {text: "time in the lap, s"}, range: [from, to], anchor: "y2", hoverformat: ".3f"}),
      yaxis: axis({title: {text: "rear stroke, mm"}, domain: [0.4, 1]}),
      yaxis2: axis({title: {text: "residual, %"}, domain: [0, 0.33], zeroline: true}),
      showlegend: true, legend: {orientation: "h", y: -0.2, x: 0}}), config);
    room.drawn = true;
  }

  const MEANING = {t_cmd: "fault requested", t_active: "first sample that differs",
    t_obs: "first sample beyond the tolerance", t_alarm: "alarm on the bus", t_heal: "alarm taken back"};

  function instants(trial) {
    const body = $("instants");
    body.replaceChildren();
    const line = (cells, kind) => {
      const row = body.insertRow();
      for (const text of cells) row.appendChild(document.createElement(kind)).textContent = text;
    };
    trial.sides.forEach((side) => {
      const zero = side.instants.t_active, names = Object.keys(side.instants);
      if (names.length)
        line([trial.sides.length > 1 ? side.name : "instant", "", "in the lap, s", "after t_active, s"], "th");
      for (const name of names)
        line([name, MEANING[name], side.instants[name].toFixed(3),
          zero === undefined ? "" : (side.instants[name] - zero).toFixed(3)], "td");
    });
  }

  const list = $("list"), rows = list ? [...list.tBodies[0].rows] : [];
  const trials = new Map(data.trials.map((trial) => [trial.id, trial]));
  let picked = null;

  function pick(id, focus) {
    const trial = trials.get(id);
    if (!trial) return;
    picked = trial;
    for (const row of rows) {
      const own = row.dataset.id === id;
      row.classList.toggle("picked", own);
      row.querySelector(".pick").tabIndex = own ? 0 : -1;
      if (own && focus) row.querySelector(".pick").focus();
      if (own) reveal(row);
    }
    $("chosen").textContent = trial.title;
    $("about").textContent = trial.about;
    freeze(trial);
    instants(trial);
  }

  // In its list alone: the page stays where it is.
  function reveal(row) {
    const box = $("box"), head = list.tHead.offsetHeight;
    if (row.offsetTop < box.scrollTop + head) box.scrollTop = row.offsetTop - head;
    const below = row.offsetTop + row.offsetHeight - box.clientHeight;
    if (below > box.scrollTop) box.scrollTop = below;
  }

  function filter() {
    const words = $("words").value.toLowerCase().split(/\s+/).filter(Boolean), condition = $("condition").value;
    const off = new Set([...document.querySelectorAll(".filters button[aria-pressed=false]")].map((b) => b.value));
    let shown = 0;
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = off.has(row.dataset.outcome) || (condition && row.dataset.condition !== condition)
        || !words.every((word) => text.includes(word));
      shown += !row.hidden;
    }
    $("shown").textContent = `${shown} of ${rows.length}`;
  }

  function sort(column, button) {
    const down = button.parentNode.getAttribute("aria-sort") === "ascending";
    for (const head of list.tHead.rows[0].cells) head.removeAttribute("aria-sort");
    button.parentNode.setAttribute("aria-sort", down ? "descending" : "ascending");
    const of = (row) => row.cells[column].dataset.sort ?? row.cells[column].textContent;
    const number = (text) => (text === "" || isNaN(text) ? Infinity : +text);
    rows.sort((a, b) => (number(of(a)) - number(of(b)) || of(a).localeCompare(of(b))) * (down ? -1 : 1));
    list.tBodies[0].append(...rows);
  }

  function wire() {
    list.tBodies[0].addEventListener("click", (event) => {
      const row = event.target.closest("tr");
      if (row) { pick(row.dataset.id, true); history.replaceState(null, "", `#${row.dataset.id}`); }
    });
    list.addEventListener("keydown", (event) => {
      const step = {ArrowDown: 1, ArrowUp: -1}[event.key];
      if (!step || !event.target.matches(".pick")) return;
      event.preventDefault();
      const shown = rows.filter((row) => !row.hidden);
      const next = shown[shown.findIndex((row) => row.dataset.id === picked.id) + step];
      if (next) pick(next.dataset.id, true);
    });
    [...list.tHead.rows[0].cells].forEach((head, column) => {
      const button = head.querySelector("button");
      button.addEventListener("click", () => sort(column, button));
    });
    for (const button of document.querySelectorAll(".filters button"))
      button.addEventListener("click", () => {
        button.setAttribute("aria-pressed", button.getAttribute("aria-pressed") === "false");
        filter();
      });
    $("words").addEventListener("input", filter);
    $("condition").addEventListener("input", filter);
    filter();
  }

  function draw() {
    if (data.histogram) histogram();
    data.plots.forEach((plot, k) => (plot.figure ? figure(plot.figure, $(`plot${k}`)) : curves(plot, $(`plot${k}`))));
    if (picked) freeze(picked);
  }

  draw();
  if (rows.length) {
    wire();
    pick(trials.has(location.hash.slice(1)) ? location.hash.slice(1) : data.first);
  }
  addEventListener("hashchange", () => pick(location.hash.slice(1)));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
})();
