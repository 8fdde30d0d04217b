"""The interface for authors of rules: `rule`, `Options`, `Context`, `Backend`.

A rule is a function from artifacts to one artifact, alone in a file of the same name. The decorator registers nothing:
it returns a `Rule`, and the loader finds it by its path.
"""

from dextera_build.calls import Job as Job
from dextera_build.calls import JobState as JobState
from dextera_build.calls import Response as Response
from dextera_build.rule.backend import Backend as Backend
from dextera_build.rule.context import Context as Context
from dextera_build.rule.context import Outcome as Outcome
from dextera_build.rule.context import Reads as Reads
from dextera_build.rule.declaration import ROUNDING as ROUNDING
from dextera_build.rule.declaration import Rule as Rule
from dextera_build.rule.declaration import Slot as Slot
from dextera_build.rule.declaration import Tolerance as Tolerance
from dextera_build.rule.declaration import rule as rule
from dextera_build.rule.options import Fraction as Fraction
from dextera_build.rule.options import Options as Options
