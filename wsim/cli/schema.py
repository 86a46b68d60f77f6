"""`wsim schema`: where the schemas of wsim are, for programs that do not import it.

`import wsim.usd` registers them by itself. Other programs (usdview, a DCC) read PXR_PLUGINPATH_NAME when they start; they open
every scene and result without it too, and then know the attributes but not their documentation and fallbacks.
"""

import os
import sys
from pathlib import Path

VARIABLE = "PXR_PLUGINPATH_NAME"


def schema_folder() -> str:
    """The folder of plugInfo.json and generatedSchema.usda in the installed package."""
    return str(Path(__file__).resolve().parent.parent / "usd" / "schema")


def schema(args) -> int:
    """Prints VARIABLE=FOLDER, with what is in the variable already behind it: export "$(wsim schema)"."""
    others = [path for path in os.environ.get(VARIABLE, "").split(os.pathsep) if path and path != schema_folder()]
    print(f"{VARIABLE}={os.pathsep.join([schema_folder(), *others])}")
    if sys.stdout.isatty():
        print('for other USD programs of this shell: export "$(wsim schema)"; Python that imports wsim.usd needs nothing',
              file=sys.stderr)
    return 0
