"""The stubs say what is there: every public name, every argument, every default."""

import ast
import inspect
from pathlib import Path

import deacal
import pytest
from deacal import _deacal

STUBS = Path(deacal.__file__).with_name("_deacal.pyi")
TREE = ast.parse(STUBS.read_text())
CLASSES = {node.name: node for node in TREE.body if isinstance(node, ast.ClassDef)}
FUNCTIONS = {node.name: node for node in TREE.body if isinstance(node, ast.FunctionDef)}
VALUES = {node.target.id: node.annotation.id for node in TREE.body if isinstance(node, ast.AnnAssign)}


def public(names):
    return {name for name in names if not name.startswith("_") or name == "__version__"}


def test_the_package_is_typed():
    assert STUBS.with_name("py.typed").exists()


def test_every_public_name_is_there_and_nothing_else():
    assert public(vars(_deacal)) - {"_deacal"} == set(CLASSES) | set(FUNCTIONS) | set(VALUES)
    assert set(deacal.__all__) == set(CLASSES) | set(FUNCTIONS) | set(VALUES)
    assert all(hasattr(deacal, name) for name in deacal.__all__)


@pytest.mark.parametrize("name", VALUES)
def test_values_are_of_the_class_that_the_stubs_state(name):
    assert type(getattr(_deacal, name)).__name__ == VALUES[name]


def stated(function):
    """Names, kinds and defaults of the arguments that a stub states."""
    empty = inspect.Parameter.empty
    a = function.args
    plain = [*a.posonlyargs, *a.args]
    defaults = [empty] * (len(plain) - len(a.defaults)) + list(a.defaults)
    out = [(arg.arg, False, default) for arg, default in zip(plain, defaults)]
    out += [(arg.arg, True, default or empty) for arg, default in zip(a.kwonlyargs, a.kw_defaults)]
    value = lambda node: node if node is empty else ast.literal_eval(node)  # noqa: E731
    return [(name, only, value(default)) for name, only, default in out]


def real(function):
    """The same of what is there."""
    parameters = inspect.signature(function).parameters.values()
    only = inspect.Parameter.KEYWORD_ONLY
    return [(p.name, p.kind is only, p.default) for p in parameters]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_take_what_the_stubs_state(name):
    assert real(getattr(_deacal, name)) == stated(FUNCTIONS[name])
    assert getattr(_deacal, name).__doc__


@pytest.mark.parametrize("name", CLASSES)
def test_classes_have_what_the_stubs_state(name):
    real_class = getattr(_deacal, name)
    bases = [base.id for base in CLASSES[name].bases]
    assert [base.__name__ for base in real_class.__bases__] == (bases or ["object"])
    members = {m.name: m for m in CLASSES[name].body if isinstance(m, ast.FunctionDef)}
    there = {n for n in vars(real_class) if not n.startswith("__") or n in members}
    if name != "DeacalError":
        assert there - {"_repr_html_"} == set(members) - {"_repr_html_"}
        assert real_class.__doc__
    for member, node in members.items():
        decorators = [d.id for d in node.decorator_list]
        attribute = vars(real_class)[member]
        if "property" in decorators:
            assert inspect.isgetsetdescriptor(attribute), member
            assert attribute.__doc__, member
        elif not member.startswith("__"):
            skip = 0 if "staticmethod" in decorators else 1
            assert real(getattr(real_class, member))[skip:] == stated(node)[skip:], member
