// From the data in the page to flat arrays, metres in the working frame.

// One drawable survey for each accepted one: the trees at their places, with the crowns that it shows; the last known
// one, or the usual one, where it shows none.
function decode({ series, states, trees, history }) {
  const size = trees.number.length;
  const x = Float64Array.from(trees.x, (value) => value / 100);
  const y = Float64Array.from(trees.y, (value) => value / 100);
  const named = series.surveys.filter((survey) => survey.states);
  const last = new Float64Array(size);
  const surveys = history.map((one, s) => {
    const area = one.area_m2.map((now, i) => (last[i] = now ?? last[i]));
    const usual = d3.median(area.filter((value) => value > 0)) ?? 1;
    return {
      ...one, role: "trees", size, x, y, name: named[s].name, said: named[s],
      radius: Float64Array.from(area, (value) => Math.sqrt((value || usual) / Math.PI)),
      usualRadius: Math.sqrt(usual / Math.PI),
      state: one.state.map((word) => states[word]),
    };
  });
  const model = { series, trees, size, timeline: surveys, surveys: { trees: surveys[0] } };
  surveys.forEach((survey, s) => {
    survey.growth = {
      previous: s > 0 ? growthBetween(surveys[s - 1], survey) : null,
      first: s > 0 ? growthBetween(surveys[0], survey) : null,
    };
  });
  return model;
}

// The change of each crown's area as a share of what it was; null for trees that not both show.
function growthBetween(before, now) {
  return now.area_m2.map((area, i) => (area !== null && before.area_m2[i] ? area / before.area_m2[i] - 1 : null));
}
