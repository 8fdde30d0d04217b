"""Options of learn.served."""

from __future__ import annotations

from pydantic import Field, field_validator, model_validator

from dextera_build.policy import contract as contracts
from dextera_build.policy.wire.opening import SCHEMES
from dextera_build.rule import Options


class ServedOptions(Options):
    """Options of learn.served."""

    address: str = "ws://127.0.0.1:8000"
    """Where the policy is asked: `ws://` or `wss://` of `dxb serve` and openpi, `http://HOST:PORT/act` of OpenVLA."""
    inputs: tuple[str, ...] = ()
    """Channels that are sent; empty: those that a policy of `dxb serve` states, `rgb` for `http://`."""
    keys: dict[str, str] = Field(default_factory=dict)
    """Channel -> its key in a request, `{rgb: observation/image}`; others have their own name, `rgb` is `image` for
    `http://`."""
    instruction: str = ""
    """The task in words; empty: the task's name, `CloseLaptop` as `close laptop`."""
    instruction_key: str = ""
    """Key of the instruction in a request; empty: `prompt`, or `instruction` for `http://`."""
    unnorm_key: str = ""
    """Name of the statistics that OpenVLA scales its actions with; empty: the model has one only."""
    horizon: int = Field(0, ge=0, le=1000)
    """Number of steps in an answer; 0: as a policy of `dxb serve` states, else 1."""
    every: int = Field(0, ge=0, le=1000)
    """Number of these steps that are carried out before the next request; 0: as a policy of `dxb serve` states, else
    all of them."""
    key_in: str = ""
    """Environment variable that holds the server's key; empty: it asks for none."""
    first_s: float = Field(120.0, gt=0, le=3600)
    """Time limit of the first answer on a connection [s]; some servers compile their network then."""
    answer_s: float = Field(10.0, gt=0, le=600)
    """Time limit of every other answer [s]."""
    revision: str = ""
    """Name of the weights behind a server that does not state it; another name runs the trials again."""

    @field_validator("address")
    @classmethod
    def _has_a_protocol(cls, address: str) -> str:
        if not address.startswith(SCHEMES):
            raise ValueError(f"`{address}` does not begin with {', '.join(SCHEMES)}")
        if "@" in address:
            raise ValueError("an address holds no password, because results show it; use `key_in`")
        return address

    @model_validator(mode="after")
    def _deployable(self) -> ServedOptions:
        if self.inputs:
            contracts.check_inputs(self.inputs)
        if self.horizon and self.every > self.horizon:
            raise ValueError(f"`every` is {self.every}, but an answer has {self.horizon} steps")
        return self
