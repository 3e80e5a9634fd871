// What colours stand for.

const ROW_COLOURS = ["blue", "orange", "green", "purple", "sky", "vermillion", "yellow"].map((name) => WONG[name]);
const STEPS = 32;
const WORDS = {
  confidence: "confidence", area_m2: "canopy area (m²)", height: "height (m)", landmark_probability: "landmark probability",
  residual_m: "distance to the partner (m)",
};

const SOURCE = WONG.orange;

function inWords(quantity) {
  return WORDS[quantity] ?? quantity.replaceAll("_", " ");
}

function quantitiesOf(model) {
  return [...new Set([...Object.keys(model.reference.quantities), ...Object.keys(model.source.quantities)])];
}

// The range over which a quantity's colours run: all of it for a probability, else what most trees have.
function rangeOf(model, quantity) {
  if (quantity === "confidence" || quantity.endsWith("probability")) return [0, 1];
  const values = [model.reference, model.source].flatMap((survey) => [...(survey.quantities[quantity] ?? [])]);
  values.sort(d3.ascending);
  const low = d3.quantileSorted(values, 0.02) ?? 0;
  const high = d3.quantileSorted(values, 0.98) ?? 1;
  return high > low ? [low, high] : [low, low + 1];
}

// A way to colour trees: `of(survey, tree)` gives a colour, `legend` says what colours mean.
function colouring(model, mode, placement, shown) {
  const entries = (list) => list.map(([text, colour]) => ({ text, colour }));
  if (mode === "match") {
    const colours = { matched: WONG.green, missing: WONG.vermillion, new: WONG.purple, unseen: WONG.grey };
    return {
      of: (survey, tree) => colours[statusOf(placement, survey.role, tree)],
      legend: entries([
        ["matched", colours.matched], [`missing in ${model.source.name}`, colours.missing],
        [`new in ${model.source.name}`, colours.new], ["not covered by the other survey", colours.unseen],
      ]),
    };
  }
  if (mode === "row") {
    return {
      of: (survey, tree) => (survey.row[tree] < 0 ? WONG.grey : ROW_COLOURS[survey.row[tree] % ROW_COLOURS.length]),
      legend: entries([["in no row, or in one without a partner", WONG.grey]]),
    };
  }
  if (mode !== "survey") return ramp(model, mode);
  return {
    of: (survey) => (survey.role === "reference" ? shown.reference : SOURCE),
    legend: entries([[model.reference.fullName, shown.reference], [model.source.fullName, SOURCE]]),
  };
}

// Colours of a quantity from low to high, in steps so that canopies of one colour can be drawn together.
function ramp(model, quantity) {
  const range = rangeOf(model, quantity);
  const colours = d3.range(STEPS).map((step) => d3.rgb(d3.interpolateCividis((step + 0.5) / STEPS)).formatHex());
  const scale = d3.scaleQuantize(range, colours);
  return {
    of: (survey, tree) => {
      const value = survey.quantities[quantity]?.[tree];
      return value === undefined ? WONG.grey : scale(value);
    },
    legend: [{ text: `${inWords(quantity)}: ${d3.format(".3~g")(range[0])} to ${d3.format(".3~g")(range[1])}`, ramp: d3.interpolateCividis }],
  };
}
