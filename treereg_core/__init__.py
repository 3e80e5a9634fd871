"""treereg lays one drone survey of an orchard exactly over another, tree on tree, and says when it cannot."""
