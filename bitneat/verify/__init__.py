# SPDX-License-Identifier: MIT
"""Does the generated C do what the controller does? `docs/verification.md` says what is checked and how.

`bitneat.verify.check.verify` is the way in. Next to nothing is imported here, so that the small processes which run the C under
test start quickly.
"""

from bitneat.callable import make_callable

make_callable(__name__)  # bitneat.verify(...)
