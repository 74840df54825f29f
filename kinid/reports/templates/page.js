// Unpacks the library of figures and draws each figure in the colours of the page. A finger that strokes a figure scrolls
// the page; for printing, figures are light and fitted to their columns, and what is folded away is shown.
(async function () {
  "use strict";
  const plots = [...document.querySelectorAll(".plot")], dark = matchMedia("(prefers-color-scheme: dark)");
  if (!plots.length) return;
  if (!window.DecompressionStream) { document.getElementById("old").hidden = false; return; }
  const raw = atob(document.getElementById("plotly").textContent), bytes = Uint8Array.from(raw, c => c.charCodeAt(0));
  const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const library = document.createElement("script");
  library.textContent = await new Response(unpacked).text();
  document.head.append(library);

  const finger = matchMedia("(pointer:coarse)").matches;
  const config = {displaylogo: false, responsive: true, displayModeBar: false};
  function draw(plot, paper) {
    const css = name => paper ? "" : getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    const text = plot.nextElementSibling.textContent.replace(/"#([0-9a-f]{6})"/gi, (whole, hex) => {
      const other = css("--c" + hex);
      return other ? `"${other}"` : whole;
    });
    const ink = css("--ink") || "#1f2937", line = css("--line") || "#e5e7eb", clear = "rgba(0,0,0,0)";
    const axis = {gridcolor: line, zerolinecolor: line, linecolor: line, automargin: true, ticks: ""};
    const bar = {colorbar: {outlinewidth: 0, ticks: "", thickness: 12}}, solid = {...axis, backgroundcolor: clear, showbackground: true};
    const template = {
      data: {heatmap: [bar], mesh3d: [bar], scatter: [{marker: bar}]},
      layout: {
        paper_bgcolor: clear, plot_bgcolor: clear, font: {color: ink, family: "system-ui, sans-serif", size: 12},
        xaxis: axis, yaxis: axis, scene: {xaxis: solid, yaxis: solid, zaxis: solid},
        hoverlabel: {bgcolor: css("--panel") || "#fff", font: {color: ink}, bordercolor: line}, legend: {bgcolor: clear},
      },
    };
    const {data, layout} = JSON.parse(text), size = plot.closest(".grid") ? 335 : 690;
    const section = plot.closest("section"), keyed = section && section.querySelector(".key");  // which says it for all
    Object.assign(layout, {template}, keyed ? {showlegend: false} : {}, finger ? {dragmode: false} : {}, paper ? {width: size, autosize: false} : {});
    return Plotly.react(plot, data, layout, config);
  }
  const all = paper => Promise.all(plots.map(plot => draw(plot, paper)));
  await all(false);
  dark.addEventListener("change", () => all(false));
  // what is folded away has no width to be drawn in
  document.querySelectorAll("details").forEach(d => d.addEventListener("toggle", () =>
    d.querySelectorAll(".plot").forEach(plot => Plotly.Plots.resize(plot))));
  addEventListener("beforeprint", () => {
    document.querySelectorAll("details").forEach(d => { d.open = true; });
    all(true);
  });
  addEventListener("afterprint", () => all(false));
})();
