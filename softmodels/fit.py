"""``python -m softmodels.fit``: a material with error bars from measured curves."""

from softmodels.commandline import main
from softmodels.fit_command import fit_material

if __name__ == "__main__":
    main(fit_material)
