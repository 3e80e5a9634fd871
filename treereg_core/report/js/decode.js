// From the data in the page to flat arrays, metres in the working frame.

function decodeSurvey(raw, role, path) {
  const size = raw.x.length;
  const x = Float64Array.from(raw.x, (value) => value / 100);
  const y = Float64Array.from(raw.y, (value) => value / 100);
  const radius = Float64Array.from(raw.area_m2, (area) => Math.sqrt(area / Math.PI));
  const parts = String(path ?? "").split(/[\\/]/).filter(Boolean);
  const name = parts.at(-1) ?? role;
  return {
    role, size, x, y, name,
    fullName: name === role ? name : `${name} (${role})`,
    id: raw.id,
    radius, usualRadius: d3.median(radius) ?? 1,
    quantities: { confidence: raw.confidence, area_m2: raw.area_m2, ...raw.attributes },
    outline: raw.outline && decodeOutline(raw.outline, x, y),
    image: raw.image,
    row: new Int32Array(size).fill(-1),
    placeInRow: new Int32Array(size),
  };
}

// Rings as corners one after the other; ring k has those from start[k] to start[k + 1]. first[i] is the first ring of
// tree i, first[i + 1] the one after its last.
function decodeOutline(raw, x, y) {
  const start = new Uint32Array(raw.ring.length + 1);
  const first = new Uint32Array(x.length + 1);
  const xy = new Float32Array(raw.xy.length);
  raw.ring.forEach((corners, k) => {
    const tree = raw.tree[k];
    start[k + 1] = start[k] + corners;
    first[tree + 1] = k + 1;
    let east = x[tree] * 100;
    let north = y[tree] * 100;
    for (let corner = start[k]; corner < start[k + 1]; corner++) {
      east += raw.xy[2 * corner];
      north += raw.xy[2 * corner + 1];
      xy[2 * corner] = east / 100;
      xy[2 * corner + 1] = north / 100;
    }
  });
  for (let i = 1; i < first.length; i++) first[i] = Math.max(first[i], first[i - 1]);
  return { start, first, xy };
}

function decodeRows(rows, reference, source) {
  if (!rows) return;
  const number = (survey, trees, row) => trees.forEach((tree, place) => {
    survey.row[tree] = row;
    survey.placeInRow[tree] = place;
  });
  rows.reference.forEach((trees, row) => number(reference, trees, row));
  rows.source.forEach((trees, row) => number(source, trees, rows.partner[row]));
}

function decode(data) {
  const reference = decodeSurvey(data.reference, "reference", data.registration.reference.path);
  const source = decodeSurvey(data.source, "source", data.registration.source.path);
  decodeRows(data.rows, reference, source);
  return {
    data, reference, source,
    surveys: { reference, source },
    placements: data.placements.map(decodePlacement),
    after: data.placements.findIndex((placement) => placement.name === "after"),
    rows: data.rows,
    boundary: data.boundary.map((ring) => ring.map(([x, y]) => [x / 100, y / 100])),
  };
}
