// A tree's crown, and its height where surveys tell it, through the surveys.

const CHART = { width: 460, height: 250, left: 44, right: 44, top: 30, bottom: 48 };
const LONGEST_LABEL = 12;

function drawChart(model, tree, colours) {
  const { width, height, left, right, top, bottom } = CHART;
  const { timeline } = model;
  const svg = d3.select("#chart").attr("viewBox", `0 0 ${width} ${height}`).attr("aria-label", "The tree's crown and height in each survey");
  svg.selectAll("*").remove();
  const x = d3.scalePoint(d3.range(timeline.length), [left, width - right]).padding(0.4);
  const every = Math.ceil(timeline.length / 6);
  const short = (name) => (name.length > LONGEST_LABEL ? `${name.slice(0, LONGEST_LABEL - 1)}…` : name);
  const axis = d3.axisBottom(x).tickValues(d3.range(0, timeline.length, every)).tickFormat((s) => short(timeline[s].name));
  svg.append("g").attr("transform", `translate(0,${height - bottom})`).call(axis);
  const quantities = [
    { name: "area_m2", text: "crown, m²", colour: WONG.green, at: left, ticks: d3.axisLeft, dash: null },
    { name: "height_m", text: "height, m", colour: colours.grown, at: width - right, ticks: d3.axisRight, dash: "5 4" },
  ];
  for (const { name, text, colour, at, ticks, dash } of quantities) {
    const values = timeline.map((survey) => survey[name][tree]);
    if (values.every((value) => value === null)) continue;
    const y = d3.scaleLinear([0, 1.1 * d3.max(values)], [height - bottom, top]).nice();
    svg.append("g").attr("transform", `translate(${at},0)`).call(ticks(y).ticks(5));
    svg.append("text").attr("x", at).attr("y", 14).attr("text-anchor", at === left ? "start" : "end").text(`${dash ? "┄" : "─"} ${text}`);
    const line = d3.line((_, s) => x(s), (value) => y(value)).defined((value) => value !== null);
    svg.append("path").attr("fill", "none").attr("stroke", colour).attr("stroke-width", 2).attr("stroke-dasharray", dash).attr("d", line(values));
    values.forEach((value, s) => value !== null && svg.append("circle").attr("cx", x(s)).attr("cy", y(value)).attr("r", 4).attr("fill", colour));
  }
  timeline.forEach((survey, s) => {
    const { colour, symbol, hollow } = STATES[survey.state[tree]] ?? { colour: colours.ink, symbol: "" };
    const mark = svg.append("text").attr("x", x(s)).attr("y", height - 12).attr("text-anchor", "middle").attr("font-size", 10);
    mark.append("tspan").attr("class", "mark").attr("fill", colour).text(`${symbol ?? (hollow ? "○" : "●")} `);
    if (timeline.length <= 6) mark.append("tspan").text(survey.state[tree]);
  });
}
