// Placements: what takes the source's coordinates to the reference's, and which trees are pairs under it.

const IDENTITY = { a: 1, b: 0, c: 0, d: 1, e: 0, f: 0 };
const ALONE = -1;

// As a canvas has it: x' = a x + c y + e, y' = b x + d y + f.
function affine([[a, c, e], [b, d, f]]) {
  return { a, b, c, d, e, f };
}

function decodePlacement(raw) {
  return { ...raw, transform: affine(raw.matrix), label: labelOf(raw.name) };
}

function labelOf(name) {
  return name[0].toUpperCase() + name.slice(1);
}

function moved(t, x, y) {
  return [t.a * x + t.c * y + t.e, t.b * x + t.d * y + t.f];
}

function inverse({ a, b, c, d, e, f }) {
  const det = a * d - b * c;
  return {
    a: d / det, b: -b / det, c: -c / det, d: a / det,
    e: (c * f - d * e) / det, f: (b * e - a * f) / det,
  };
}

// First `t`, then `u`.
function compose(u, t) {
  const [e, f] = moved(u, t.e, t.f);
  return {
    a: u.a * t.a + u.c * t.b, c: u.a * t.c + u.c * t.d,
    b: u.b * t.a + u.d * t.b, d: u.b * t.c + u.d * t.d, e, f,
  };
}

// The way in a straight line: every tree moves evenly.
function between(from, to, share) {
  const mixed = {};
  for (const key of "abcdef") mixed[key] = (1 - share) * from[key] + share * to[key];
  return mixed;
}

// What a placement makes of one tree: matched, alone (the other survey should show it), or unseen there.
function statusOf(placement, role, tree) {
  const partner = placement[role][tree];
  if (partner >= 0) return "matched";
  if (partner !== ALONE) return "unseen";
  return role === "reference" ? "missing" : "new";
}

// East and north from the placed source tree to its partner, metres; null without one.
function residual(model, placement, tree) {
  const partner = placement.source[tree];
  if (partner < 0) return null;
  const [x, y] = moved(placement.transform, model.source.x[tree], model.source.y[tree]);
  return [model.reference.x[partner] - x, model.reference.y[partner] - y];
}

function residuals(model, placement) {
  const found = [];
  for (let tree = 0; tree < model.source.size; tree++) {
    const vector = residual(model, placement, tree);
    if (vector) found.push(vector);
  }
  return found;
}
