// What colours of trees mean. By state, missing, new and replanted ones have a sign too.

const STATES = {
  present: { colour: WONG.green },
  missing: { colour: WONG.vermillion, shape: "cross", symbol: "✕" },
  new: { colour: WONG.purple, shape: "plus", symbol: "+" },
  replanted: { colour: WONG.orange, shape: "diamond", symbol: "◇" },
  unseen: { colour: WONG.grey, hollow: true },
};
const MODES = { state: "state", previous: "growth since last time", first: "growth since the first" };
const STEPS = 25;
const percent = (share) => (share === null || share === undefined ? "–" : d3.format("+.0%")(share));

// From crowns that shrank, over unchanged ones, to those that grew: `of(growth)` and the legend. Equal factors are equally
// far from the middle.
function growthColours(model, mode, { shrunk, same, grown }) {
  const factors = model.timeline.flatMap((survey) => (survey.growth[mode] ?? []).filter((share) => share !== null))
    .map((share) => Math.abs(Math.log1p(share))).sort(d3.ascending);
  const most = Math.max(d3.quantileSorted(factors, 0.95) ?? 0, 0.05);
  const ramp = d3.piecewise(d3.interpolateLab, [shrunk, same, grown]);
  const colours = d3.range(STEPS).map((step) => d3.rgb(ramp(step / (STEPS - 1))).formatHex());
  const scale = d3.scaleQuantize([-most, most], colours);
  const text = `crown: ${percent(Math.expm1(-most))} or less, unchanged, ${percent(Math.expm1(most))} or more`;
  return { of: (share) => scale(Math.log1p(share)), legend: [{ text, ramp }, { text: "cannot be compared", colour: WONG.grey, hollow: true }] };
}
