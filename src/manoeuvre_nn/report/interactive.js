// Draws the charts of the page: as plotly.js has them, with zoom and what stands under the pointer.
"use strict";
(() => {
  const INK = "#1c2430", GRID = "#dddddd", GAP = 26, TOP = 44, LINE = 17, BOTTOM = 48, SIDES = 78, LOWEST = 260, HIGHEST = 720, BESIDE = 560;
  const HALO = ["1px 1px", "-1px 1px", "1px -1px", "-1px -1px"].map(way => way + " 2px #fff").join(", "); // keeps a word readable that lies on a curve
  const config = { displaylogo: false, modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]] };
  const finger = matchMedia("(pointer: coarse)").matches; // a finger on a figure scrolls the page; zoom is in the bar
  const lines = panel => panel.title ? panel.title.split("<br>").length : 0;
  const base = (width, plot, first) => ({ // so high that the first panel's title and the legend stand above it
    width, height: plot + TOP + LINE * lines(first) + BOTTOM, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", dragmode: finger ? false : "zoom",
    font: { family: "system-ui, sans-serif", size: 12, color: INK }, margin: { l: 64, r: 14, t: TOP + LINE * lines(first), b: BOTTOM },
    legend: { orientation: "h", x: 0, y: 1 + (LINE * lines(first) + 2) / plot, yanchor: "bottom" },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: "#8a929c", activecolor: INK }, shapes: [], annotations: [],
  });
  const axis = (title, more) => ({ title: { text: title, standoff: 6 }, gridcolor: GRID, zeroline: false, linecolor: INK, ticks: "outside", exponentformat: "power", ...more });

  function furnish(layout, panel, x, y) {
    for (const [from, to, color] of panel.spans)
      layout.shapes.push({ type: "rect", layer: "below", xref: x, yref: y + " domain", x0: from, x1: to, y0: 0, y1: 1, fillcolor: color, line: { width: 0 } });
    if (panel.level !== null)
      layout.shapes.push({ type: "line", layer: "below", xref: x + " domain", yref: y, x0: 0, x1: 1, y0: panel.level, y1: panel.level, line: { color: "#777", width: 1 } });
    panel.arrows.forEach(([words, arrow, angle, color], row) => {
      const place = { xref: x + " domain", yref: y + " domain", x: 0, y: 1, showarrow: false, yshift: -18 - 28 * row };
      layout.annotations.push({ ...place, text: arrow, textangle: angle, xshift: 4, font: { size: 28, color } },
                              { ...place, text: words, xanchor: "left", xshift: 38, font: { size: 12, color } });
    });
    if (panel.title)
      layout.annotations.push({ xref: x + " domain", yref: y + " domain", x: 0, y: 1, xanchor: "left", yanchor: "bottom", align: "left", showarrow: false, text: panel.title, font: { size: 12 } });
  }

  function stacked(chart, width) { // one time axis a column, so that all panels are zoomed and read together
    const columns = width < 700 ? 1 : chart.columns, ROW = columns > 1 ? 130 : 155, rows = Math.ceil(chart.panels.length / columns);
    const room = rows * (ROW + GAP), layout = base(width, room, chart.panels[0]), traces = [], across = 1 / columns, between = columns > 1 ? 110 / width : 0;
    // Panels come row by row; in one column those of each column stay together.
    const order = columns === chart.columns ? chart.panels
      : [...Array(chart.columns).keys()].flatMap(c => chart.panels.filter((_, k) => k % chart.columns === c));
    order.forEach((panel, k) => {
      const row = Math.floor(k / columns), column = k % columns, n = k ? k + 1 : "";
      const top = 1 - row * (ROW + GAP) / room, x = "x" + (column ? column + 1 : ""), y = "y" + n;
      traces.push(...panel.traces.map(trace => ({ ...trace, type: "scatter", xaxis: x, yaxis: y,
        ...(trace.textfont && width < 700 ? { textfont: { ...trace.textfont, size: 9 } } : {}) })));
      layout["yaxis" + n] = axis(panel.ylabel, { domain: [top - ROW / room, top], anchor: x, automargin: true,
        ...(panel.limits ? { range: panel.limits.slice(2) } : {}) });
      const last = row === Math.floor((order.length - 1 - column) / columns);
      if (last) layout["xaxis" + (column ? column + 1 : "")] = axis(panel.xlabel, { domain: [column * across + (column ? between / 2 : 0), (column + 1) * across - (column < columns - 1 ? between / 2 : 0)],
        anchor: y, ...(column ? { matches: "x" } : {}), showspikes: true, spikemode: "across", spikethickness: 1, spikedash: "dot", spikecolor: "#777" });
      furnish(layout, panel, x, y);
    });
    return [traces, { ...layout, hovermode: "x", hoversubplots: "axis" }];
  }

  // Height over width of what a map shows; its ends are those of its curves unless they are given.
  function ends(panel) {
    if (panel.limits) return panel.limits;
    const even = trace => trace.y.map((_, k) => trace.x0 + k * trace.dx);
    const all = key => panel.traces.flatMap(trace => trace[key] ?? even(trace)).filter(value => value !== null);
    const [x, y] = [all("x"), all("y")].map(values => values.length ? [Math.min(...values), Math.max(...values)] : [0, 1]);
    const edge = .06 * Math.max(x[1] - x[0], y[1] - y[0]) || 1;
    return [x[0] - edge, x[1] + edge, y[0] - edge, y[1] + edge];
  }
  const ratio = panel => { const [left, right, low, high] = ends(panel); return (high - low) / (right - left); };

  // Words of marks where they have room: on the panel, and off each other; as they were asked for if they have.
  const PLACES = ["top right", "top left", "bottom right", "bottom left", "top center", "bottom center"];
  const pen = document.createElement("canvas").getContext("2d");
  function placed(panel, width, plot) {
    const size = width < 700 ? 10 : 12, [left, right, low, high] = ends(panel), room = width - SIDES, taken = [];
    pen.font = `${size}px system-ui, sans-serif`;
    const fit = [room / (right - left), plot / (high - low)], [across, up] = panel.equal ? fit.fill(Math.min(...fit)) : fit;
    return panel.traces.map(trace => {
      if (!trace.text?.[0]) return trace;
      const word = trace.marker ? trace.text[0] : `\u00a0${trace.text[0]}\u00a0`; // plotly leaves no room beside a word alone
      const x = room / 2 + (trace.x[0] - (left + right) / 2) * across, y = plot / 2 - (trace.y[0] - (low + high) / 2) * up;
      const long = pen.measureText(word).width, tall = 1.05 * size, off = trace.marker ? 6.6 : 0; // as plotly has it
      const box = place => {
        const [height, side] = place.split(" ");
        const from = side === "right" ? x + off : side === "left" ? x - off - long : x - long / 2, top = height === "top" ? y - off - tall : y + off;
        return [from, from + long, top, top + tall];
      };
      const inside = ([from, to, top, bottom]) => from > 0 && to < room + 10 && top > 0 && bottom < plot;
      const free = ([from, to, top, bottom]) => taken.every(one => to < one[0] || from > one[1] || bottom < one[2] || top > one[3]);
      const choices = [trace.textposition, ...PLACES].filter(place => inside(box(place)));
      const best = choices.find(place => free(box(place))) ?? choices[0] ?? trace.textposition;
      taken.push(box(best));
      return { ...trace, text: [word], textposition: best, textfont: { ...trace.textfont, size, shadow: HALO } };
    });
  }

  function single(panel, width, plot) {
    const layout = { ...base(width, plot, panel), hovermode: "closest" }, limits = panel.equal ? ends(panel) : panel.limits;
    layout.xaxis = axis(panel.xlabel, limits ? { range: limits.slice(0, 2) } : {});
    layout.yaxis = axis(panel.ylabel, { automargin: true, ...(limits ? { range: limits.slice(2) } : {}), ...(panel.equal ? { scaleanchor: "x" } : {}) });
    furnish(layout, panel, "x", "y");
    const where = panel.equal ? "%{y:.4~g} north, %{x:.4~g} east" : "%{x:.4~g}, %{y:.4~g}";
    const traces = placed(panel, width, plot).map(trace => ({ type: "scatter", ...trace, ...(trace.hoverinfo ? {} : {
      hovertemplate: (trace.customdata ? "%{customdata:.4~g} s: " : "") + where + `<extra>%{${trace.meta ? "meta" : "fullData.name"}}</extra>` }) }));
    return [traces, layout];
  }

  // Widths of panels that do not share their time: maps side by side; a tall one leaves room for what is beside it.
  function widths(chart, room) {
    if (room < 700 || chart.panels.length < 2) return chart.panels.map(() => room);
    if (chart.columns > 1) return chart.panels.map(() => Math.floor(room / chart.columns));
    const tall = chart.panels[0].equal && ratio(chart.panels[0]) > 1.2;
    const first = tall ? Math.max(Math.ceil(BESIDE / ratio(chart.panels[0])) + SIDES, 420) : room;
    return chart.panels.map((_, k) => !tall ? room : k ? room - first : first);
  }

  // Heights of these panels: what stands beside a map is as high as it is, so that no gap is left below.
  function heights(chart, each, room) {
    const own = chart.panels.map((panel, k) => panel.equal ? Math.min(Math.max(ratio(panel) * (each[k] - SIDES), LOWEST), HIGHEST) : k ? LOWEST : 360);
    if (each.every(width => width === room)) return own;
    if (chart.columns > 1) return own.map((_, k) => {
      const row = Math.floor(k / chart.columns) * chart.columns;
      return Math.min(Math.max(...own.slice(row, row + chart.columns)), BESIDE);
    });
    const frame = panel => TOP + LINE * lines(panel) + BOTTOM, whole = BESIDE + frame(chart.panels[0]);
    return own.map((_, k) => k ? Math.max(whole / (own.length - 1) - frame(chart.panels[k]), LOWEST) : BESIDE);
  }

  function draw(figure) {
    const chart = JSON.parse(figure.querySelector("script").textContent), live = document.createElement("div");
    live.className = "live";
    figure.append(live);
    figure.classList.add("drawn");
    const room = live.clientWidth - 1, each = widths(chart, room), high = heights(chart, each, room);
    (chart.one_time ? [null] : chart.panels).forEach((panel, k) => {
      const holder = document.createElement("div"), [traces, layout] = panel ? single(panel, each[k], high[k]) : stacked(chart, room);
      live.append(holder);
      Plotly.newPlot(holder, traces, layout, config);
    });
  }

  const watch = new IntersectionObserver(seen => {
    for (const one of seen.filter(each => each.isIntersecting)) { watch.unobserve(one.target); draw(one.target); }
  }, { rootMargin: "400px" });
  document.querySelectorAll("figure.chart").forEach(figure => watch.observe(figure));

  let width = innerWidth, soon; // a phone that is turned
  addEventListener("resize", () => {
    if (innerWidth === width) return;
    width = innerWidth;
    clearTimeout(soon);
    soon = setTimeout(() => document.querySelectorAll("figure.drawn").forEach(figure => {
      figure.querySelector(".live").remove();
      draw(figure);
    }), 200);
  });
})();
