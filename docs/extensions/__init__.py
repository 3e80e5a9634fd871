"""What the site needs beyond Sphinx: formulas without scripts, and no page that asks a network for anything."""
