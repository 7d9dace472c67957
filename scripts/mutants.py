"""Breaks the sampler of partitions on purpose, a line at a time, and tells which test notices.

Every mutant drops a Hastings term, a gate, or the refresh of something kept. Each is a copy of the
sampler in a namespace of its own; `tests/test_association_mcmcda_chain.py` runs on it in a process
of its own, which may crash. The source stays as it is. Exit 1 if a mutant lives or its line is not
there any more. `make` does not run this: it takes some minutes. `python scripts/mutants.py [WORD
...]` tries those whose name has such a word.
"""

from __future__ import annotations

import importlib.util
import inspect
import os
import resource
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import nanobind

ROOT = Path(__file__).parents[1]
CORE = ROOT / "src" / "trackfield" / "_core"
BATCH = 12  # mutants a compilation
MOST_S = 240  # of the processor, for the tests of a mutant


class Mutant(NamedTuple):
    """A line of a header, `mcmcda_FILE.hpp`, and what it becomes."""

    name: str
    file: str
    line: str
    broken: str


def _without(file: str, name: str, line: str, term: str) -> Mutant:
    """Drop a term of a line."""
    return Mutant(name, file, line, line.replace(term, "", 1))


BIRTH = "const double forth = schedule_.log_of(kBirth, K) + log_q;"
UNBORN = "const double back = schedule_.log_of(kDeath, K + 1) - std::log(double(K + 1));"
DEATH = "const double forth = schedule_.log_of(kDeath, K) - std::log(double(K));"
REBORN = (
    "const double back = schedule_.log_of(kBirth, K - 1) + "
    "births_.log_draw(t.nodes[0].report, t.nodes[1].report) + log_suffix(t, 2);"
)
SPLIT = "const double forth = schedule_.log_of(kSplit, K) - std::log(double(n));"
JOINED = "const double back = schedule_.log_of(kMerge, K + 1) - std::log(double(undo));"
MERGE = "const double forth = schedule_.log_of(kMerge, K) - std::log(double(n));"
CUT = "const double back = schedule_.log_of(kSplit, K - 1) - std::log(double(undo));"
LONGER = "const double forth = schedule_.log_of(kExtension, K) + log_q;\n        const"
UNLONGER = "const double back = schedule_.log_of(kReduction, K) - std::log(double(reductions(t)));"
SHORTER = "const double forth = schedule_.log_of(kReduction, K) - std::log(double(n));"
UNSHORTER = (
    "const double back = schedule_.log_of(kExtension, K) + "
    "picks_.log_forced(t.nodes[left - 1], t.nodes[left].report) + log_suffix(t, left + 1);"
)
REDRAWN = "const double forth = drawn - std::log(double(redraws(t)));"
UNREDRAWN = "const double back = log_suffix(t, from) - std::log(double(redraws(one_)));"
SWAPPED = (
    "if (log_u < gain + std::log(double(n)) - std::log(double(swaps_after_.size()))) return true;"
)

HASTINGS = (
    _without("moves", "birth: its move", BIRTH, "schedule_.log_of(kBirth, K) + "),
    _without("moves", "birth: its draw", BIRTH, " + log_q"),
    _without("moves", "birth: its suffix", "log_q += draw_suffix(one_);", "log_q += "),
    _without("moves", "birth: the death's move", UNBORN, "schedule_.log_of(kDeath, K + 1)"),
    _without("moves", "birth: the death's choice", UNBORN, " - std::log(double(K + 1))"),
    _without("moves", "death: its move", DEATH, "schedule_.log_of(kDeath, K)"),
    _without("moves", "death: its choice", DEATH, " - std::log(double(K))"),
    _without("moves", "death: the birth's move", REBORN, "schedule_.log_of(kBirth, K - 1) + "),
    _without(
        "moves",
        "death: the birth's pair",
        REBORN,
        "births_.log_draw(t.nodes[0].report, t.nodes[1].report) + ",
    ),
    _without("moves", "death: the birth's suffix", REBORN, " + log_suffix(t, 2)"),
    _without("moves", "split: its move", SPLIT, "schedule_.log_of(kSplit, K)"),
    _without("moves", "split: its cut", SPLIT, " - std::log(double(n))"),
    _without("moves", "split: the merge's move", JOINED, "schedule_.log_of(kMerge, K + 1)"),
    _without("moves", "split: the merge's pair", JOINED, " - std::log(double(undo))"),
    _without("moves", "split: merges of the halves", "merges().size()) + 1 +", " + 1"),
    _without(
        "moves",
        "split: merges after the new end",
        "+ starts_after(tracks_, t.nodes[cut - 1].report) +",
        "+ starts_after(tracks_, t.nodes[cut - 1].report) ",
    ),
    Mutant(
        "split: merges before the new start",
        "moves",
        "ends_before(tracks_, t.nodes[cut].report);",
        "0;",
    ),
    _without("moves", "merge: its move", MERGE, "schedule_.log_of(kMerge, K)"),
    _without("moves", "merge: its pair", MERGE, " - std::log(double(n))"),
    _without("moves", "merge: the split's move", CUT, "schedule_.log_of(kSplit, K - 1)"),
    _without("moves", "merge: the split's cut", CUT, " - std::log(double(undo))"),
    _without("moves", "merge: cuts of the first", "all_cuts() - cuts(a)", " - cuts(a)"),
    _without("moves", "merge: cuts of the second", " - cuts(b) +", " - cuts(b)"),
    _without("moves", "merge: cuts of the whole", " + cuts(one_);", " + cuts(one_)"),
    _without("moves", "extension: its move", LONGER, "schedule_.log_of(kExtension, K) + "),
    _without("moves", "extension: its draw", LONGER, " + log_q"),
    _without("moves", "extension: its suffix", "log_q += draw_suffix(t);", "log_q += "),
    _without(
        "moves", "extension: the reduction's move", UNLONGER, "schedule_.log_of(kReduction, K)"
    ),
    _without(
        "moves", "extension: the reduction's choice", UNLONGER, " - std::log(double(reductions(t)))"
    ),
    _without("moves", "reduction: its move", SHORTER, "schedule_.log_of(kReduction, K)"),
    _without("moves", "reduction: its choice", SHORTER, " - std::log(double(n))"),
    _without(
        "moves", "reduction: the extension's move", UNSHORTER, "schedule_.log_of(kExtension, K) + "
    ),
    _without(
        "moves",
        "reduction: the extension's first pick",
        UNSHORTER,
        "picks_.log_forced(t.nodes[left - 1], t.nodes[left].report) + ",
    ),
    _without("moves", "reduction: the extension's suffix", UNSHORTER, " + log_suffix(t, left + 1)"),
    Mutant(
        "extension before: its draw",
        "moves",
        "const double forth = schedule_.log_of(kExtension, K) + log_q;\n        if (!take(one_",
        "const double forth = schedule_.log_of(kExtension, K);\n        if (!take(one_",
    ),
    Mutant(
        "reduction before: the extension's draw",
        "moves",
        " + picks_.log_before(t.nodes[1].report, t.nodes[2].report, t.nodes[0].report);",
        ";",
    ),
    _without("moves", "update: its draw", REDRAWN, "drawn "),
    _without("moves", "update: its place", REDRAWN, " - std::log(double(redraws(t)))"),
    _without("moves", "update: the way back's draw", UNREDRAWN, "log_suffix(t, from) "),
    _without(
        "moves", "update: the way back's place", UNREDRAWN, " - std::log(double(redraws(one_)))"
    ),
    _without("moves", "switch: its pair", SWAPPED, " + std::log(double(n))"),
    _without(
        "moves", "switch: the way back's pair", SWAPPED, " - std::log(double(swaps_after_.size()))"
    ),
    Mutant(
        "switch: too early a no", "moves", "log_u >= gain + std::log(double(n))", "log_u >= gain"
    ),
)

PROPOSALS = (
    _without("picks", "uniform: the gap", "log_q += log_gap(d);", "log_q += log_gap(d);"),
    _without(
        "picks",
        "uniform: the report",
        "log_q -= std::log(double(n));",
        "log_q -= std::log(double(n));",
    ),
    _without("picks", "uniform: going on", "log_q += link ? log_go_ + picked", "log_go_ + "),
    Mutant(
        "uniform: stopping for want of reports",
        "picks",
        "empty += window_.set.gaps[d - 1];",
        "empty += 0;",
    ),
    _without(
        "picks",
        "uniform: the gap, on the way back",
        "return log_gap(d) - std::log(double(count_free(i, d)));",
        "log_gap(d) ",
    ),
    _without(
        "picks",
        "uniform: the report, on the way back",
        "return log_gap(d) - std::log(double(count_free(i, d)));",
        " - std::log(double(count_free(i, d)))",
    ),
    _without(
        "picks",
        "uniform: going on, on the way back",
        "return log_go_ + log_uniform(node.report, to);",
        "log_go_ + ",
    ),
    Mutant(
        "informed: going on, on the way back",
        "picks",
        "weight_of(to) / (total + stop_weight(node.report))",
        "weight_of(to) / total",
    ),
    Mutant("informed: going on", "picks", "log_q += std::log(total / (stop + total));", ""),
    Mutant("informed: stopping", "picks", "log_q += std::log(stop / (stop + total));", ""),
    Mutant("informed: the pick", "picks", "log_q += std::log(candidates_[c].weight / total);", ""),
    _without("births", "birth: the gap", "return picks_.log_gap(d) - std", "picks_.log_gap(d) "),
    Mutant("birth: the slot", "births", "double(slots()) * double(starts)", "double(starts)"),
    Mutant(
        "birth: the first report", "births", "double(slots()) * double(starts)", "double(slots())"
    ),
    _without(
        "births",
        "birth: the second report, on the way back",
        "starts(slot, d)) - std::log(double(picks_.count_free(first, d)));",
        " - std::log(double(picks_.count_free(first, d)))",
    ),
    Mutant(
        "informed birth: the sum",
        "births",
        "log_q = std::log(pair_[window_.number(*drawn)] / all);",
        "log_q = std::log(pair_[window_.number(*drawn)]);",
    ),
)

GATES = (
    Mutant("links: distance", "window", "if (dx * dx + dy * dy > most * most) continue;", ""),
    _without(
        "window",
        "links: noise",
        "most = far + set.margin * (sigma + width(b));",
        " + set.margin * (sigma + width(b))",
    ),
    _without(
        "tracks",
        "free: frozen slots",
        "owner_[i] < 0 && window_.reports[i].slot >= window_.set.frozen;",
        " && window_.reports[i].slot >= window_.set.frozen",
    ),
    Mutant("death: frozen", "moves", "if (tracks_.frozen(t) > 0) return false;", ""),
    Mutant(
        "cuts: two reports left",
        "tracks",
        "std::max(0, length - 1 - std::max(2, frozen))",
        "std::max(0, length - 1 - std::max(1, frozen))",
    ),
    Mutant(
        "cuts: frozen",
        "tracks",
        "std::max(0, length - 1 - std::max(2, frozen))",
        "std::max(0, length - 3)",
    ),
    Mutant(
        "reduction: two reports left",
        "moves",
        "return t.length - std::max(2, tracks_.frozen(t));",
        "return t.length - std::max(1, tracks_.frozen(t));",
    ),
    Mutant(
        "reduction: frozen",
        "moves",
        "return t.length - std::max(2, tracks_.frozen(t));",
        "return t.length - 2;",
    ),
    Mutant(
        "update: frozen",
        "moves",
        "return t.length - std::max(1, tracks_.frozen(t)) + 1;",
        "return t.length;",
    ),
    Mutant("update: two reports", "moves", "if (one_.length < 2) {", "if (one_.length < 1) {"),
    Mutant(
        "merge: starts only",
        "swaps",
        "if (b >= 0 && tracks.place(l.to) == 0 && w",
        "if (b >= 0 && w",
    ),
    Mutant(
        "merge: frozen",
        "swaps",
        "tracks.place(l.to) == 0 && w.reports[l.to].slot >= w.set.frozen) out",
        "tracks.place(l.to) == 0) out",
    ),
    Mutant(
        "merge: starts only, counted",
        "swaps",
        "n += tracks.owner(l.to) >= 0 && tracks.place(l.to) == 0 &&",
        "n += tracks.owner(l.to) >= 0 &&",
    ),
    Mutant("switch: a head each", "swaps", "if (b <= a || j == 0 ||", "if (b <= a ||"),
    Mutant(
        "switch: every pair once",
        "swaps",
        "if (b <= a || j == 0 ||",
        "if (b < 0 || b == a || j == 0 ||",
    ),
    Mutant(
        "switch: both may follow",
        "swaps",
        "if (w.find(tracks[b].nodes[j - 1].report, tail)) out",
        "if (w.reports[tracks[b].nodes[j - 1].report].slot < w.reports[tail].slot) out",
    ),
    Mutant("switch: frozen", "swaps", "if (w.reports[tail].slot < w.set.frozen) continue;", ""),
    Mutant(
        "death: the region",
        "window",
        "const double s = survival[t] * inside(now);",
        "const double s = survival[t];",
    ),
    Mutant(
        "death: far from the border",
        "window",
        "if (std::isinf(set.region[0])) return true;",
        "return true;",
    ),
    Mutant("death: none after the last slot", "window", "if (left == 0) return 0;", ""),
)

REFRESHES = (
    Mutant(
        "merges known",
        "moves",
        "if (taken) swaps_known_ = merges_known_ = false;",
        "if (taken) swaps_known_ = false;",
    ),
    Mutant(
        "swaps known",
        "moves",
        "if (taken) swaps_known_ = merges_known_ = false;",
        "if (taken) merges_known_ = false;",
    ),
    Mutant(
        "births: sums of touched pairs",
        "births",
        "for (const int32_t h : window_.before(i)) stale_[h] = 1;",
        "",
    ),
    Mutant("places of owned reports", "tracks", "place_[i] = p;", "if (from == 0) place_[i] = p;"),
    Mutant(
        "owner of touched reports",
        "tracks",
        "if (window_.set.informed) touched_.push_back(i);",
        "if (owner >= 0) touched_.push_back(i);",
    ),
    Mutant("numbers of moved tracks", "tracks", "position_[live_[k]] = k;", ""),
    Mutant("score: split", "moves", "t.score = head;", ""),
    Mutant(
        "score: extension",
        "moves",
        "t.score = score;\n        tracks_.own(k, before);",
        "tracks_.own(k, before);",
    ),
    Mutant(
        "score: reduction",
        "moves",
        "t.length = left;\n        t.score = score;",
        "t.length = left;",
    ),
    Mutant("score: chain", "chain", "score_ = tracks_.score();\n        if", "if"),
    Mutant("score: best", "chain", "if (score_ > best_score_) remember();", ""),
    Mutant("after a no: extension", "moves", "t.length = before;\n", "\n"),
    Mutant(
        "after a no: reduction",
        "moves",
        "tracks_.own(k, left);\n            return false;",
        "return false;",
    ),
    Mutant(
        "after a no: death", "moves", "tracks_.own(k, 0);\n        return false;", "return false;"
    ),
    Mutant("after a no: switch", "moves", "exchange(s);\n        return false;", "return false;"),
    Mutant("release: death", "moves", "tracks_.release(k, 0);\n        const", "const"),
    Mutant("release: reduction", "moves", "tracks_.release(k, left);\n", "\n"),
    Mutant(
        "release: update",
        "moves",
        "tracks_.release(k, from);\n        tracks_.copy_head",
        "tracks_.copy_head",
    ),
    Mutant(
        "prefix of a track",
        "tracks",
        "Node next{link.to, node.prefix + link.constant, node.belief};",
        "Node next{link.to, link.constant, node.belief};",
    ),
    Mutant("misses between", "window", "misses += std::log(1 - detected(t, i));", ""),
    Mutant("survival between", "window", "misses += std::log(survival[t]);", ""),
    Mutant("noise over a gap", "window", "a.pp + b.dt * (2 * a.pv + b.dt * a.vv) + b.pp,", "b.pp,"),
)

MUTANTS = HASTINGS + PROPOSALS + GATES + REFRESHES


def sources(mutant: Mutant | None) -> dict[str, str]:
    """Read the sampler's files, one of them broken; `LookupError` if its line is not there once."""
    texts = {path.name: path.read_text() for path in CORE.glob("mcmcda*.[ch]pp")}
    texts["xoshiro.hpp"] = (CORE / "xoshiro.hpp").read_text()
    door = "NB_MODULE(_mcmcda, m)"
    texts["mcmcda.cpp"] = texts["mcmcda.cpp"].replace(door, "void bind(nb::module_ &m)")
    if mutant:
        name = f"mcmcda_{mutant.file}.hpp"
        there = texts[name].count(mutant.line)
        if there != 1 or mutant.line == mutant.broken:
            raise LookupError(f"{mutant.name}: its line is there {there} times")
        texts[name] = texts[name].replace(mutant.line, mutant.broken)
    return texts


def build(mutants: list[Mutant | None], place: Path) -> ModuleType:
    """Compile mutants into one module, a submodule each; no two of all may share a namespace."""
    system = sorted(
        {
            line
            for text in sources(None).values()
            for line in text.splitlines()
            if line.startswith("#include <")
        }
    )
    code = ["#include <nanobind/nanobind.h>", *system]
    doors: list[str] = []
    for number, mutant in enumerate(mutants):
        own = f"{place.name}_{number}"
        folder = place / own
        folder.mkdir()
        for name, text in sources(mutant).items():
            guard = f"{own}_{name.replace('.', '_')}"  # equal files pass for one of `once`
            text = text.replace("#pragma once", "")
            (folder / name).write_text(f"#ifndef {guard}\n#define {guard}\n{text}\n#endif\n")
        code.append(f'namespace {own} {{\n#include "{own}/mcmcda.cpp"\n}}')
        doors.append(f'{{ auto s = m.def_submodule("{own}"); {own}::bind(s); }}')
    code.append(f"NB_MODULE({place.name}, m) {{ {' '.join(doors)} }}")
    (place / "all.cpp").write_text("\n".join(code))
    include = Path(nanobind.include_dir())
    out = place / f"{place.name}.so"
    command = [
        *("c++", "-std=c++20", "-O1", "-w", "-shared", "-fPIC", "-fvisibility=hidden"),
        *("-fno-strict-aliasing", "-ffp-contract=off"),
        f"-I{include}",
        f"-I{include.parent / 'ext' / 'robin_map' / 'include'}",
        f"-I{sysconfig.get_paths()['include']}",
        *(str(place / "all.cpp"), str(include.parent / "src" / "nb_combined.cpp")),
        *("-o", str(out)),
    ]
    subprocess.run(command, check=True)  # noqa: S603 - our own files
    spec = importlib.util.spec_from_file_location(place.name, out)
    if spec is None or spec.loader is None:
        raise ImportError(str(out))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def cases(tests: ModuleType) -> Iterator[tuple[str, Callable[[], None]]]:
    """Every test of the module with each of its arguments, as pytest would run them."""
    for name, function in inspect.getmembers(tests, inspect.isfunction):
        if not name.startswith("test_"):
            continue
        windows = (
            list(tests.WINDOWS) if "name" in inspect.signature(function).parameters else [None]
        )
        ways = [False, True] if "informed" in inspect.signature(function).parameters else [None]
        for window in windows:
            for informed in ways:
                given: dict[str, Any] = {"name": window, "informed": informed}
                given = {key: value for key, value in given.items() if value is not None}
                label = "-".join(str(value) for value in given.values())
                yield f"{name}[{label}]", lambda f=function, g=given: f(**g)


def first_failure(tests: ModuleType, sampler: type) -> str:
    """Name of the first test that fails with this sampler, or nothing."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        resource.setrlimit(resource.RLIMIT_CPU, (MOST_S, MOST_S))
        sys.modules["mcmcda_twin"].Sampler = sampler  # type: ignore[attr-defined]
        for label, run in cases(tests):
            os.write(write, f"{label}\n".encode())
            try:
                run()
            except Exception:  # noqa: BLE001 - any failure is what we look for
                os._exit(1)
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as lines:
        begun = lines.read().split()
    _, status = os.waitpid(child, 0)
    if status == 0:
        return ""
    return begun[-1] + (f" (signal {os.WTERMSIG(status)})" if os.WIFSIGNALED(status) else "")


def load_tests() -> ModuleType:
    """Import the tests, and work out once what all mutants are held against."""
    sys.path.insert(0, str(ROOT / "tests"))
    tests = importlib.import_module("test_association_mcmcda_chain")
    for name in tests.WINDOWS:
        for informed in (False, True):
            tests.transitions(name, informed)
    return tests


def main(words: list[str]) -> int:
    """Try the mutants whose name has one of the words, or all."""
    chosen = [m for m in MUTANTS if not words or any(word in m.name for word in words)]
    tests, lived = load_tests(), 0
    with tempfile.TemporaryDirectory() as folder:
        for start in range(0, len(chosen), BATCH):
            sound: list[Mutant | None] = [] if start else [None]
            batch = [*sound, *chosen[start : start + BATCH]]
            place = Path(folder) / f"batch{start}"
            place.mkdir()
            built = build(batch, place)
            for number, mutant in enumerate(batch):
                killer = first_failure(tests, getattr(built, f"{place.name}_{number}").Sampler)
                if mutant is None:
                    if killer:
                        print(f"the source as it is fails {killer}")
                        return 1
                    continue
                lived += not killer
                print(
                    f"killed  {mutant.name}: {killer}" if killer else f"LIVES   {mutant.name}",
                    flush=True,
                )
    print(f"{len(chosen) - lived} of {len(chosen)} mutants killed")
    return 1 if lived else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
