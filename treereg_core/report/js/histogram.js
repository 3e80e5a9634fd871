// Histograms of the residuals, before the move and under the placement that is shown.

const CHART = { width: 460, height: 230, left: 44, right: 12, top: 26, bottom: 40 };

function drawHistogram(id, title, unit, series, domain) {
  const svg = d3.select(`#${id}`).attr("viewBox", `0 0 ${CHART.width} ${CHART.height}`);
  svg.selectAll("*").remove();
  svg.attr("aria-label", title);
  const x = d3.scaleLinear(domain, [CHART.left, CHART.width - CHART.right]).nice();
  const bin = d3.bin().domain(x.domain()).thresholds(x.ticks(30));
  const binned = series.map((one) => ({ ...one, bins: bin(one.values) }));
  const most = d3.max(binned, (one) => d3.max(one.bins, (b) => b.length)) || 1;
  const y = d3.scaleLinear([0, most], [CHART.height - CHART.bottom, CHART.top]).nice();
  for (const { bins, colour, filled } of binned) {
    const bars = svg.append("g").attr("fill", filled ? colour : "none").attr("stroke", colour).attr("fill-opacity", 0.55);
    if (filled) {
      bars.selectAll("rect").data(bins.filter((b) => b.length)).join("rect")
        .attr("x", (b) => x(b.x0)).attr("width", (b) => Math.max(0, x(b.x1) - x(b.x0) - 0.5))
        .attr("y", (b) => y(b.length)).attr("height", (b) => y(0) - y(b.length));
    } else {
      const steps = bins.flatMap((b) => [[b.x0, b.length], [b.x1, b.length]]);
      bars.append("path").attr("stroke-width", 2).attr("d", d3.line((p) => x(p[0]), (p) => y(p[1]))(steps));
    }
  }
  svg.append("g").attr("transform", `translate(0,${CHART.height - CHART.bottom})`).call(d3.axisBottom(x).ticks(6));
  svg.append("g").attr("transform", `translate(${CHART.left},0)`).call(d3.axisLeft(y).ticks(5));
  svg.append("text").attr("x", CHART.width / 2).attr("y", CHART.height - 4).attr("text-anchor", "middle").text(unit);
  const key = svg.append("g");
  series.forEach(({ name, colour }, k) => {
    key.append("rect").attr("x", CHART.left + 8 + 150 * k).attr("y", 6).attr("width", 10).attr("height", 10).attr("fill", colour);
    key.append("text").attr("x", CHART.left + 23 + 150 * k).attr("y", 15).text(name);
  });
}

function drawHistograms(model, placement) {
  const before = residuals(model, model.placements[0]);
  const now = residuals(model, placement);
  const lengths = (vectors) => vectors.map(([east, north]) => Math.hypot(east, north));
  const limit = d3.max([...lengths(before), ...lengths(now)]) || 1;
  const shown = { name: placement.label, values: lengths(now), colour: WONG.blue, filled: true };
  const first = { name: "Before", values: lengths(before), colour: WONG.vermillion, filled: false };
  drawHistogram("lengths", "Distances of matched trees", "distance of matched trees, metres", placement.name === "before" ? [shown] : [shown, first], [0, limit]);
  drawHistogram("components", "Distances of matched trees to the east and to the north", `from source to reference, metres (${placement.label.toLowerCase()})`, [
    { name: "to the east", values: now.map(([east]) => east), colour: WONG.green, filled: true },
    { name: "to the north", values: now.map(([, north]) => north), colour: WONG.purple, filled: false },
  ], [-limit, limit]);
  byId("residuals-text").textContent = placement.matched
    ? `${placement.label}: ${number(placement.matched, 0)} pairs, ${metres(placement.residual_rms_m)} apart (RMS). This is mostly `
      + "the noise of outlines, which averages out over many trees; it is not the error of the placement."
    : `${placement.label}: no trees are matched.`;
}
