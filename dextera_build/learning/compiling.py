"""Networks that torch compiles for a training: code for one device, made at the first step."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from torch import nn

from dextera_build.errors import MachineError


@contextmanager
def compiled(network: nn.Module, folder: Path) -> Iterator[None]:
    """Run the network, and its encoder of pictures, as compiled code in the block; its weights stay where they are.

    Args:
        network: The network.
        folder: Holds the code; what lies there is not used again.

    Raises:
        MachineError: There is no compiler, or it refuses the code.
    """
    places = {"TORCHINDUCTOR_CACHE_DIR": str(folder / "compiled"), "TRITON_CACHE_DIR": str(folder / "triton")}
    before = {name: os.environ.get(name) for name in places}
    os.environ.update(places)
    # They take seconds to import, which other trainings need not spend, and set the first of these if nobody did.
    from torch import _dynamo
    from torch._dynamo.exc import TorchDynamoException
    from torch._inductor import config, cpp_builder, exc

    try:
        # Compilers in processes of their own would outlive the node.
        with config.patch(compile_threads=1):
            cpp_builder.get_cpp_compiler()
            for part in (network, getattr(network, "eyes", None)):
                if part is not None:
                    part.compile()
            yield
    except (exc.InvalidCxxCompiler, TorchDynamoException) as error:
        raise MachineError(
            "the network could not be compiled",
            code="DXB-E449",
            facts={"it says": (str(error).strip() or type(error).__name__).splitlines()[0][:300]},
            hint="install a C++ compiler (`apt install g++`), or leave out `compiled`",
        ) from None
    finally:
        _dynamo.reset()
        for name, value in before.items():
            os.environ.pop(name)
            os.environ.update({name: value} if value is not None else {})
