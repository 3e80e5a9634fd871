// Colours that people with any colour vision tell apart (Wong 2011, doi:10.1038/nmeth.1618), light and dark.

const WONG = {
  orange: "#e69f00", sky: "#56b4e9", green: "#009e73", yellow: "#f0e442", blue: "#0072b2", vermillion: "#d55e00",
  purple: "#cc79a7", grey: "#8f9693",
};

const themed = {
  light: {
    reference: WONG.blue, ink: "#1b1f1d", ground: "#f3f4f0", paper: "#ffffff",
    shrunk: WONG.vermillion, same: "#c3c7c1", grown: WONG.blue,
  },
  dark: {
    reference: WONG.sky, ink: "#e7eae8", ground: "#232826", paper: "#161918",
    shrunk: "#ff8a4d", same: "#59605c", grown: WONG.sky,
  },
};

function theme(printing) {
  if (printing) return { ...themed.light, ground: "#ffffff" };
  return matchMedia("(prefers-color-scheme: dark)").matches ? themed.dark : themed.light;
}
