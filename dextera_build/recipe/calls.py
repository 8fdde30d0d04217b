"""Builds calls from declarations: rule and backend, checked inputs, complete options with their places."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dextera_build.code.code_digest import EXCHANGE, FILE
from dextera_build.code.companions import Companion, Companions, each_of, paths_of
from dextera_build.code.distributions import version_of
from dextera_build.code.loader import Library, RuleFile
from dextera_build.engine.graph import Call, Input, Item, Leaf, Output, Pack, RuleFacts
from dextera_build.errors import (
    ArtifactError,
    MachineError,
    Place,
    RecipeError,
    UsageError,
    did_you_mean,
    install_extra,
    listing,
    smallest_extra,
)
from dextera_build.recipe import backend_options, files, folders, matrix
from dextera_build.recipe.backends import Choice, Wish, choose, given_of, taking, with_used
from dextera_build.recipe.kinds import fits, parameters, type_name
from dextera_build.recipe.option_values import checked
from dextera_build.recipe.profiles import Profile
from dextera_build.recipe.schema import KEYS, CallDecl, listed
from dextera_build.recipe.scope import Absent, Scope
from dextera_build.recipe.settings import COMMAND_LINE, Setting, put
from dextera_build.recipe.strict_yaml import Node
from dextera_build.workers.retries import Retries, name_of

if TYPE_CHECKING:
    from dextera_build.rule import Slot

Address = tuple[str, ...]


class CallMaker:
    """Turns declarations into calls, for one profile and one set of command-line settings.

    Args:
        library: Provides rules.
        profile: The build's profile.
        backends: Rule -> backend, or several in order of preference, from the command line.
        settings: Options from the command line.
    """

    def __init__(
        self,
        library: Library,
        profile: Profile,
        backends: Mapping[str, str],
        settings: tuple[Setting, ...],
    ) -> None:
        self._library = library
        self._profile = profile
        self._backends = {
            rule: Wish(tuple(text.split(",")), "command line", COMMAND_LINE) for rule, text in backends.items()
        }
        self._settings = settings
        self.fallback = False
        """Whether a profile's next backend may take the place of a missing one."""
        self._is_read: set[str] = set()
        self._unread: dict[str, str] = {}
        """Setting of a backend that some call does not run -> the warning."""
        self._facts: dict[tuple[str, ...], RuleFacts] = {}
        self._chosen: dict[int, tuple[RuleFile, Choice | None, Companions]] = {}
        """Identity of facts -> their owner."""
        for rule in backends:
            library.find(rule)

    @property
    def rules(self) -> tuple[RuleFacts, ...]:
        """Rules of all calls built so far."""
        return tuple(self._facts.values())

    def rule_file(self, decl: CallDecl) -> RuleFile:
        """The rule that a declaration names."""
        return self._library.find(decl.rule, decl.place)

    def returned(self, decl: CallDecl, address: Address) -> Any:
        """The artifact type of the results of a declaration."""
        rule = self.rule_file(decl).rule
        given = [decl.arguments[rule.typed_by]] if rule.typed_by in decl.arguments else []
        given += [each.value for each in self._settings if each.call == address and each.option == (rule.typed_by,)]
        return rule.returned({rule.typed_by: given[-1].value} if given else {})

    def values(self, decl: CallDecl, values: matrix.Values | None) -> dict[str, Node]:
        """Arguments of a call that change with one copy of its matrix; `values` is None outside a matrix.

        Raises:
            RecipeError: An argument refers to a value that does not exist.
        """
        slots = self.rule_file(decl).rule.slots
        arguments = {name: node for name, node in decl.arguments.items() if name not in slots}
        arguments |= {"backend": decl.backend} if decl.backend is not None else {}
        if values is None:
            matrix.refuse_outside(arguments)
            return {}
        return matrix.filled(arguments, values)

    def refuse_labels(self, group: Address, known: Iterable[str]) -> None:
        """Refuse settings for copies that a matrix does not have.

        Raises:
            UsageError: A setting names an unknown copy.
        """
        copies = list(known)
        for label in sorted(self.labels(group).keys() - set(copies)):
            raise UsageError(
                f"`{'.'.join(group)}` has no copy `{label}`",
                code="DXB-U169",
                facts={"copies": listing(copies)},
                hint=did_you_mean(label, copies),
            )

    def place_settings(self, calls: Collection[Address]) -> None:
        """Tell the names of calls from those of groups of options in the settings.

        Raises:
            UsageError: A setting names an unknown call.
        """
        self._settings = tuple(setting.at(calls) for setting in self._settings)
        self._refuse_unused_settings(calls)

    def labels(self, group: Address) -> dict[str, str]:
        """Label -> setting for the copies that settings name."""
        depth = len(group) - 1
        return {
            label: setting.text
            for setting in self._settings
            if setting.call[:-1] == group and (label := setting.labels[depth]) is not None
        }

    def concerns(self, call: Address, label: str) -> bool:
        """Whether a setting names this copy."""
        return any(setting.call == call and label in setting.labels for setting in self._settings)

    def is_unset(self, call: Address) -> bool:
        """Whether no setting names a call."""
        return all(setting.call != call for setting in self._settings)

    def _refuse_unused_settings(self, calls: Collection[Address]) -> None:
        known = [".".join(address) for address in calls]
        for setting in self._settings:
            if setting.call not in calls:
                raise UsageError(
                    f"`{setting.text}`: no node is called `{'.'.join(setting.call)}`",
                    code="DXB-U107",
                    facts={"nodes": listing(known, most=40)},
                    hint=did_you_mean(".".join(setting.call), known),
                )

    def call(
        self,
        decl: CallDecl,
        scope: Scope,
        address: Address,
        changed: Mapping[str, Node] | None = None,
        label: str | None = None,
    ) -> Call:
        """The call of a declaration; with `changed` and `label`, the call of a single copy of its group."""
        found = self.rule_file(decl)
        arguments = {**decl.arguments, **{k: v for k, v in (changed or {}).items() if k != "backend"}}
        applied = [
            setting
            for setting in self._settings
            if setting.call == address and (all(s is None for s in setting.labels) or label in setting.labels)
        ]
        for setting in applied:
            put(arguments, setting.option, setting.value)
        slots = found.rule.slots
        bound = {name: node for name, node in arguments.items() if name in slots}
        choice = self._choice(found, (changed or {}).get("backend", decl.backend), decl, given_of(bound, scope))
        named = folders.named(self._library, decl, found, arguments)
        facts = self._rule_facts(found, choice, named)
        self._refuse_unknown(decl, arguments, found, named, ".".join(address))
        inputs = self._inputs(decl, bound, slots, scope)
        given = {name: node for name, node in arguments.items() if name not in slots}
        groups = {*found.backends, *(each.name for each in named.values())}
        own = {name: node for name, node in given.items() if name not in groups}
        options = checked(decl, found.rule.options, Node(own, decl.place), node=".".join(address))
        if choice is not None:
            options |= backend_options.of_chosen(decl, found, choice, given, ".".join(address))
            self._note_unread(found, applied, choice.backend.name)
        options |= {each.name: folders.options(decl, each, given.get(each.name)) for each in named.values()}
        places = {name: node.place for name, node in given.items()}
        return Call(address[-1], facts, options, inputs, decl.place, places, decl.salt, decl.on_failure)

    def _note_unread(self, found: RuleFile, applied: Iterable[Setting], chosen: str) -> None:
        """Note the settings that this call reads, and those for another backend than the chosen one."""
        for setting in applied:
            group = setting.option[0]
            if group in found.backends and group != chosen:
                self._unread[setting.text] = f"nothing reads `--set {setting.text}`: {found.path} runs `{chosen}`"
            else:
                self._is_read.add(setting.text)

    def warn_unread(self) -> None:
        """Warn of settings that no call reads."""
        self._library.warnings.update({t: told for t, told in self._unread.items() if t not in self._is_read})

    def _choice(self, found: RuleFile, wanted: Node | None, decl: CallDecl, inputs: Iterable[str]) -> Choice | None:
        wish = self._backends.get(found.path)
        if wish is None and wanted is not None:
            wish = Wish(listed(wanted, "backend"), "recipe", wanted.place)
        if wish is None and (names := taking(found, inputs, self._profile)):
            wish = Wish(names, f"given `{'`, `'.join(found.backends[names[0]].facts.takes)}`", decl.place)
        return choose(found, wish, self._profile, decl.place, self._library.machine, fallback=self.fallback)

    def _rule_facts(self, found: RuleFile, choice: Choice | None, named: Mapping[str, Companion]) -> RuleFacts:
        chosen = (choice.backend.name, choice.why) if choice else ("", "")
        key = (found.path, *chosen, *(str(each.file) for each in named.values()))
        if key not in self._facts:
            companions = {option: (each,) for option, each in named.items()}
            self._facts[key] = facts_of(self._library, found, choice, companions)
            self._chosen[id(self._facts[key])] = found, choice, companions
        return self._facts[key]

    def running(self, facts: RuleFacts, companions: Companions) -> RuleFacts:
        """The facts of a rule, with the code that runs its inputs."""
        found, choice, named = self._chosen[id(facts)]
        companions = {**named, **companions}
        files = (f"{slot} {each.file}" for slot, found_in in companions.items() for each in found_in)
        key = (facts.path, facts.backend or "", facts.chosen, *files)
        if key not in self._facts:
            self._facts[key] = facts_of(self._library, found, choice, companions)
        return self._facts[key]

    def _refuse_unknown(
        self,
        decl: CallDecl,
        arguments: Mapping[str, Node],
        found: RuleFile,
        named: Mapping[str, Companion],
        address: str,
    ) -> None:
        slots, options = found.rule.slots, found.rule.options.model_fields
        known = {*slots, *options, *found.backends, *(each.name for each in named.values()), *KEYS}
        for name, node in arguments.items():
            if name not in known:
                where = decl.keys.get(name, node.place)
                asked = address if where.file.startswith(COMMAND_LINE.file) else ""
                of_folder = folders.hint(self._library, found, named, name)
                raise RecipeError(
                    f"`{decl.rule}` has no input or option `{name}`",
                    code="DXB-R105",
                    where=where,
                    facts={"inputs": listing(slots), "options": listing(options, most=40)},
                    hint=of_folder or did_you_mean(name, known) or backend_options.hint(name, found.backends, asked),
                )

    def _inputs(
        self, decl: CallDecl, given: Mapping[str, Node], slots: Mapping[str, Slot], scope: Scope
    ) -> dict[str, Input]:
        inputs: dict[str, Input] = {}
        for name, slot in slots.items():
            if name not in given:
                if not slot.optional:
                    raise RecipeError(
                        f"`{decl.rule}` needs the input `{name}`",
                        code="DXB-R106",
                        where=decl.place,
                        facts={"it takes": type_name(slot.annotation), "known here": listing(scope.visible(), 30)},
                        hint=f"add `{name}: $...`",
                    )
                continue
            bound = _resolved(given[name], name, slot, scope)
            if bound is None and not slot.optional:
                raise RecipeError(
                    f"`{decl.rule}` needs the input `{name}`, but `{given[name].value}` is not given",
                    code="DXB-R106",
                    where=given[name].place,
                )
            if bound is not None:
                inputs[name] = bound
        return inputs


def facts_of(
    library: Library, found: RuleFile, choice: Choice | None, companions: Companions | None = None
) -> RuleFacts:
    """The part of a key that describes a rule, its backend and the companions of its inputs and options.

    Raises:
        MachineError: A package that the rule declares is not installed.
    """
    rule, backend = found.rule, choice.backend if choice else None
    used = with_used(found, backend) if backend else []
    declared = (*rule.packages, *(package for each in used for package in each.facts.packages))
    if missing := [name for name in rule.packages if version_of(name) is None]:
        raise MachineError(
            f"{found.path} needs {listing(missing)}, which is not installed",
            code="DXB-E302",
            hint=install_extra(smallest_extra(missing)),
        )
    program = backend.program if backend else None
    # How values look outside is part of the result, although no backend imports it.
    exchange, beside = [EXCHANGE] if program else [], [each.file for each in each_of(companions or {})]
    code = library.code.of(found.file, *(each.file for each in used), *exchange, *beside)
    own = program.digests() if program else {}
    types = {**{name: slot.annotation for name, slot in rule.slots.items()}, "return": rule.returns}
    return RuleFacts(
        path=found.path,
        version=rule.version,
        code={**code.definitions, **{name: {FILE: digest} for name, digest in own.items()}},
        packages={name: str(version) for name, version in library.packages(found, code, declared).items()},
        backend=backend.name if backend else None,
        weights=library.machine.models.pinned(dict.fromkeys(name for each in used for name in each.facts.weights)),
        types={name: _schema(annotation, name, found.place) for name, annotation in types.items()},
        cpus=rule.cpus,
        memory_gb=rule.memory_gb + sum(library.machine.memory_gb(each.facts) for each in used),
        gpus=rule.gpus,
        gpu_gb=library.machine.device_gb(backend.facts) if backend else 0.0,
        named=tuple(sorted(rule.resources.items())),
        retries=Retries(rule.retries, tuple(_spelled(kind) for kind in rule.retry_on), rule.retry_wait_s),
        discovers=str(library.project) if rule.discovers else "",
        sources=code.sources,
        program=own,
        companions=paths_of(companions or {}),
        chosen=choice.why if choice else "",
        passed=choice.passed if choice else (),
        missing=choice.missing if choice else (),
        hint=choice.hint if choice else None,
    )


def _spelled(kind: type[BaseException] | str) -> str:
    return kind if isinstance(kind, str) else name_of(kind)


def _schema(annotation: Any, name: str, where: Place) -> str:
    from dextera_build.artifacts.core.forms import form_of
    from dextera_build.artifacts.core.schema import schema_digest

    try:
        form_of(annotation, name)  # a union must be readable from the store
    except ArtifactError as error:
        error.where = where
        raise
    return schema_digest(annotation)[:16]


def _resolved(node: Node, name: str, slot: Slot, scope: Scope) -> Input | None:
    text = node.value
    if isinstance(text, dict):
        return _packed(node, name, slot, scope)
    if not isinstance(text, str) or not text.startswith("$"):
        raise RecipeError(
            f"the input `{name}` takes a reference, this is {node.kind}",
            code="DXB-R107",
            where=node.place,
            hint=f"`{name}: $...`; files are declared under `inputs`",
        )
    bound = scope.resolve(text, node.place)
    if bound.input is None:
        return None
    given = bound.kind()
    if not fits(slot.annotation, given):
        if isinstance(bound.input, Leaf):
            raise files.misfit(bound.input, text, name, slot.annotation, node.place)
        raise RecipeError(
            f"`{name}` takes {type_name(slot.annotation)}, but `{text}` is {type_name(given)}",
            code="DXB-R107",
            where=node.place,
        )
    clash = bound.narrow(name, slot.annotation) if isinstance(bound, Absent) else None
    if clash is not None:
        raise RecipeError(
            f"`{name}` takes {type_name(slot.annotation)}, but `{text}` is given to `{clash[0]}`, too, "
            f"which takes {type_name(clash[1])}",
            code="DXB-R107",
            where=node.place,
        )
    if slot.optional and isinstance(bound.input, Output | Item) and bound.input.fields:
        return replace(bound.input, optional=True)
    return bound.input


def _packed(node: Node, name: str, slot: Slot, scope: Scope) -> Input:
    """A collection listed in the recipe: `trials: {act: $act_trials, ppo: $ppo_trials}`."""
    inner = parameters(slot.annotation)
    if not inner or not slot.annotation.__name__.startswith("Collection["):
        raise RecipeError(
            f"the input `{name}` takes {type_name(slot.annotation)}, this is a mapping",
            code="DXB-R107",
            where=node.place,
            hint=f"`{name}: $...`",
        )
    part = replace(slot, annotation=inner[0], optional=True)
    parts = {label: _resolved(given, f"{name}.{label}", part, scope) for label, given in node.value.items()}
    return Pack({label: source for label, source in parts.items() if source and not isinstance(source, Pack)})
