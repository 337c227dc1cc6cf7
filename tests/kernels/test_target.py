from __future__ import annotations

import platform

import pytest

from leg_dynamics.errors import UnsupportedError
from leg_dynamics.kernels import compile_program, target
from leg_dynamics.kernels.target import LEVEL_VARIABLE, LEVELS, Target, host_target, target_for


@pytest.fixture
def machine(monkeypatch):
    """Choose the machine that is seen."""

    def choose(level, triple="x86_64-unknown-linux-gnu"):
        monkeypatch.setattr(target, "_host", lambda: target_for(level, triple))

    return choose


def test_the_plainest_machine_of_each_level():
    found = [target_for(level, "x86_64-unknown-linux-gnu") for level in LEVELS]
    assert [machine.width for machine in found] == [8, 4, 2, 2]
    assert [machine.fused for machine in found] == [True, True, False, True]
    assert [machine.cpu for machine in found] == ["x86-64-v4", "x86-64-v3", "x86-64", "generic"]
    assert target_for("sse2", "x86_64-apple-darwin").is_x86
    assert not target_for("neon", "aarch64-unknown-linux-gnu").is_x86


def test_this_machine_is_described_by_what_it_has_and_lacks():
    host = host_target()
    assert host.level in LEVELS
    if host.level in ("avx512", "avx2"):
        features = set(host.features.split(","))
        assert "+fma" in features
        assert all(feature[0] in "+-" for feature in features)
        assert ("+avx512f" in features) == (host.level == "avx512")


@pytest.mark.parametrize("host", ["avx512", "avx2", "sse2"])
def test_lower_levels_can_be_asked_for_and_others_not(machine, monkeypatch, host):
    machine(host)
    for level in LEVELS:
        monkeypatch.setenv(LEVEL_VARIABLE, level)
        if level != "neon" and LEVELS.index(level) >= LEVELS.index(host):
            assert host_target().level == level
        else:
            with pytest.raises(UnsupportedError, match=rf"{LEVEL_VARIABLE}='{level}'.*{host}"):
                host_target()


@pytest.mark.parametrize("level", ["avx", "AVX2", "avx2 ", "none", "512"])
def test_an_unknown_level_is_refused_by_name(lab, monkeypatch, level):
    monkeypatch.setenv(LEVEL_VARIABLE, level)
    with pytest.raises(UnsupportedError, match="is not a level of vector instructions of this machine: leave it unset"):
        host_target()
    with pytest.raises(NotImplementedError):
        compile_program(lab.program([()], lambda x: x + 1))


def test_an_empty_level_is_none(machine, monkeypatch):
    machine("avx2")
    monkeypatch.setenv(LEVEL_VARIABLE, "")
    assert host_target().level == "avx2"


def test_on_arm_there_is_one_level(machine, monkeypatch):
    machine("neon", "aarch64-unknown-linux-gnu")
    assert host_target().level == "neon"
    for level in ("sse2", "avx2", "sve"):
        monkeypatch.setenv(LEVEL_VARIABLE, level)
        with pytest.raises(UnsupportedError, match="use one of neon"):
            host_target()


@pytest.mark.parametrize("name", ["riscv64", "ppc64le", "i686", ""])
def test_another_family_of_processors_is_refused_by_name(monkeypatch, name):
    monkeypatch.setattr(platform, "machine", lambda: name)
    with pytest.raises(UnsupportedError, match=f"kernels are not compiled for {name}: use x86-64 or aarch64"):
        target._host.__wrapped__()


@pytest.mark.parametrize(
    ("missing", "level"),
    [
        ((), "avx512"),
        (("avx512dq",), "avx2"),
        (("avx512f", "avx2"), "sse2"),
        (("fma",), "sse2"),
        (("avx512vl",), "avx2"),
    ],
    ids=str,
)
def test_a_level_needs_all_of_its_features(monkeypatch, missing, level):
    import llvmlite.binding as llvm

    class Features(dict):
        def flatten(self):
            return ",".join(f"{'+' if has else '-'}{name}" for name, has in sorted(self.items()))

    names = ("avx512f", "avx512dq", "avx512vl", "avx512bw", "avx2", "fma")
    features = Features({name: name not in missing for name in names})
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(llvm, "get_host_cpu_features", lambda: features)
    found = target._host.__wrapped__()
    assert found.level == level
    # a processor's name promises instructions that a virtual machine may hide
    assert all(f"-{name}" in found.features.split(",") for name in missing) or found == target_for("sse2", found.triple)


def test_targets_are_told_apart_by_everything():
    base = target_for("avx2", "x86_64-unknown-linux-gnu")
    assert repr(base) != repr(Target(base.level, base.triple, base.cpu, base.width, base.fused, "-bmi2"))
