"""Gives this folder's plugin a name of its own: `python rename.py near_trees`. It removes itself in the end."""

import re
import sys
from pathlib import Path

HOME = Path(__file__).parent
OLD = "template"


def main() -> None:
    """Put the name into texts and file names: in each the form that is used there."""
    name = sys.argv[1] if len(sys.argv) == 2 else ""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        sys.exit("usage: python rename.py NAME, in lower-case letters, digits and underscores")
    Path(__file__).unlink()
    class_name = "".join(word.capitalize() for word in name.split("_"))
    found = [path for path in HOME.rglob("*") if not any(part.startswith(".") for part in path.relative_to(HOME).parts)]
    for path in sorted(found, reverse=True):  # what a folder holds before the folder
        if path.suffix in {".py", ".toml", ".md"}:
            text = path.read_text(encoding="utf-8")
            text = text.replace(f"treereg-{OLD}", f"treereg-{name.replace('_', '-')}").replace(OLD, name)
            path.write_text(text.replace(OLD.capitalize(), class_name), encoding="utf-8")
        path.rename(path.with_name(path.name.replace(OLD, name)))


if __name__ == "__main__":
    main()
