// Which tree is meant: under a pointer, or the next one in a direction.

function makePicker(model) {
  const trees = Object.values(model.surveys).map((survey) => ({
    survey,
    tree: d3.quadtree(d3.range(survey.size), (i) => survey.x[i], (i) => survey.y[i]),
  }));
  // The nearest tree of these surveys, within reach (metres) of a point.
  return ({ x, y, reach, roles, transform }) => {
    let best = null;
    for (const { survey, tree } of trees) {
      if (!roles.includes(survey.role)) continue;
      const t = survey.role === "source" ? transform : IDENTITY;
      const [u, v] = moved(inverse(t), x, y);
      const i = tree.find(u, v, reach);
      if (i === undefined) continue;
      const distance = Math.hypot(survey.x[i] - u, survey.y[i] - v);
      if (!best || distance < best.distance) best = { role: survey.role, tree: i, distance };
    }
    return best && { role: best.role, tree: best.tree };
  };
}

// The nearest tree of the same survey within 45 degrees of a direction on the screen.
function neighbour(model, selected, transform, [east, north]) {
  const survey = model.surveys[selected.role];
  const t = selected.role === "source" ? transform : IDENTITY;
  const [x, y] = moved(t, survey.x[selected.tree], survey.y[selected.tree]);
  let best = null;
  let least = Infinity;
  for (let i = 0; i < survey.size; i++) {
    const [u, v] = moved(t, survey.x[i], survey.y[i]);
    const along = (u - x) * east + (v - y) * north;
    const aside = Math.abs((u - x) * north - (v - y) * east);
    if (along <= 0 || aside > along) continue;
    const distance = along + aside;
    if (distance < least) [best, least] = [i, distance];
  }
  return best === null ? selected : { role: selected.role, tree: best };
}
