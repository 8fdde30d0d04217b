"""Which recipes there are, by name alone; completion waits for this, so it loads nothing."""

import os

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


def addresses(folders: "Iterable[str]") -> "Iterator[tuple[str, str]]":
    """Address and file of every recipe below some folders; of one address the first counts."""
    seen = set()
    for folder in folders:
        inside = ((place, name) for place, _, names in os.walk(folder) for name in names if name.endswith(".yaml"))
        for file in sorted((f"{place}/{name}" for place, name in inside), key=lambda file: file.split("/")):
            address = file[len(folder) + 1 : -len(".yaml")]
            if "." not in address and address.isprintable() and address not in seen:
                seen.add(address)
                yield address, file
