"""How the folders of the repository are installed: as one package, so that no name of a user's own is taken."""

from setuptools import find_packages, setup

FOLDERS = {
    "inkjet_env": "inkjet_env",
    "inkjet_env.optimizers": "optimizers",
    "inkjet_env.experiments": "experiments",
}

setup(
    package_dir=FOLDERS,
    packages=[
        name + found.removeprefix(folder)
        for name, folder in FOLDERS.items()
        for found in find_packages(include=[folder, f"{folder}.*"])
    ],
)
