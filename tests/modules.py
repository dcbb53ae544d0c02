"""Every module of ours, by its dotted name, as a file of the repository."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = {"inkjet_env": "inkjet_env", "inkjet_env.optimizers": "optimizers", "inkjet_env.experiments": "experiments"}
MODULES = {
    ".".join((package, *file.relative_to(ROOT / folder).with_suffix("").parts)).removesuffix(".__init__"): file
    for package, folder in FOLDERS.items()
    for file in sorted((ROOT / folder).rglob("*.py"))
}
