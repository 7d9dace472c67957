"""Breaks the sampler of partitions on purpose, a line at a time, and tells which test notices.

Every mutant drops a Hastings term, a gate, or the refresh of something kept. All of them are
compiled into one sampler, whose lines look up a global number to know in which way to be broken;
`tests/test_association_mcmcda_chain.py` runs on each in a process of its own, which may crash. The
source stays as it is. Exit 1 if a mutant lives or its line is not there any more. `make` does not
run this: it takes some minutes. `python scripts/mutants.py [WORD ...]` tries those whose name has
such a word; `--page` writes what noticed them to `docs/concepts/association_mcmcda.md`.
"""

from __future__ import annotations

import argparse
import importlib.util
import itertools
import os
import re
import resource
import subprocess
import sys
import sysconfig
import tempfile
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import nanobind
import pytest

ROOT = Path(__file__).parents[1]
CORE = ROOT / "src" / "trackfield" / "_core"
BEGIN, END = "<!-- mutants -->", "<!-- end of mutants -->"
PAGE = ROOT / "docs" / "concepts" / "association_mcmcda.md"
SOUND = -1  # number of no mutant: the source as it is
JOBS = 3  # mutants under test at a time
MOST_S = 90  # of the processor, for the tests of a mutant; the source as it is takes 15


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
    Mutant("free: a uniform pick", "picks", "tracks_.free(l.to) && n-- == 0", "n-- == 0"),
    Mutant("free: uniform picks, counted", "picks", "n += tracks_.free(l.to);", "n += 1;"),
    Mutant(
        "free: uniform picks, if any",
        "picks",
        "if (tracks_.free(l.to)) return true;",
        "return true;",
    ),
    Mutant(
        "free: an informed pick", "picks", "if (!tracks_.free(l.to)) continue;\n            ", ""
    ),
    Mutant("free: the pick before", "picks", "if (tracks_.free(h) || h == also) ", ""),
    _without(
        "births",
        "free: the first report of a uniform birth",
        "return tracks_.free(i) && picks_.any_free(i, d);",
        "tracks_.free(i) && ",
    ),
    _without(
        "births",
        "free: the first report of an informed birth",
        "if (!tracks_.free(i) || sum_[i] <= 0) continue;",
        "!tracks_.free(i) || ",
    ),
    Mutant(
        "free: the second report of an informed birth",
        "births",
        "if (!tracks_.free(l.to)) continue;\n                first = i;",
        "first = i;",
    ),
    Mutant(
        "free: the sum of informed births",
        "births",
        "if (!tracks_.free(i)) continue;\n            if (stale_",
        "if (stale_",
    ),
    _without(
        "births",
        "free: the sum after a first report",
        "if (tracks_.free(l.to)) sum += pair_",
        "if (tracks_.free(l.to)) ",
    ),
    _without(
        "moves",
        "reduction before: frozen",
        "if (tracks_.frozen(t) > 0 || t.length < 3) return false;",
        "tracks_.frozen(t) > 0 || ",
    ),
    _without(
        "moves",
        "reduction before: two reports left",
        "if (tracks_.frozen(t) > 0 || t.length < 3) return false;",
        " || t.length < 3",
    ),
    _without(
        "swaps",
        "merge: frozen, counted",
        "tracks.place(l.to) == 0 && w.reports[l.to].slot >= w.set.frozen;",
        " && w.reports[l.to].slot >= w.set.frozen",
    ),
    _without(
        "swaps",
        "switch: frozen, the second tail",
        "j == 0 || w.reports[l.to].slot < w.set.frozen) continue;",
        " || w.reports[l.to].slot < w.set.frozen",
    ),
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
        ";",
    ),
    Mutant(
        "births: sums at the start",
        "births",
        "stale_.assign(window_.size(), 1);",
        "stale_.assign(window_.size(), 0);",
    ),
    Mutant("places of owned reports", "tracks", "place_[i] = p;", "if (from == 0) place_[i] = p;"),
    Mutant(
        "owner of touched reports",
        "tracks",
        "if (window_.set.informed) touched_.push_back(i);",
        "if (owner >= 0) touched_.push_back(i);",
    ),
    Mutant("numbers of moved tracks", "tracks", "position_[live_[k]] = k;", ""),
    Mutant("numbers of new tracks", "tracks", "position_[at] = count();", ""),
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
    Mutant(
        "after a no: update",
        "moves",
        "tracks_.own(k, from);\n            return false;",
        "return false;",
    ),
    Mutant("owner: a new track", "tracks", "own(count() - 1, 0);", ""),
    Mutant("owner: extension", "moves", "tracks_.own(k, before);", ""),
    Mutant(
        "owner: update", "moves", "tracks_.own(k, from);\n        return taken;", "return taken;"
    ),
    Mutant(
        "owner: a track in place of another",
        "moves",
        "proposed);\n        tracks_.own(k, from);",
        "proposed);",
    ),
    Mutant("owner: switch, the first", "moves", "tracks_.own(s.a, s.i);", ""),
    Mutant("owner: switch, the second", "moves", "tracks_.own(s.b, s.j);", ""),
    Mutant(
        "release: a track in place of another",
        "moves",
        "tracks_.release(k, from);\n        std::swap",
        "std::swap",
    ),
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

KINDS = {
    "Hastings terms": HASTINGS,
    "Probabilities of proposals": PROPOSALS,
    "Gates": GATES,
    "What is kept": REFRESHES,
}
MUTANTS = [mutant for kind in KINDS.values() for mutant in kind]


def sources() -> dict[str, str]:
    """Read the files of the sampler."""
    texts = {path.name: path.read_text() for path in CORE.glob("mcmcda*.[ch]pp")}
    return texts | {"xoshiro.hpp": (CORE / "xoshiro.hpp").read_text()}


class Change(NamedTuple):
    """Mutant `number` makes `new` of the text from `begin` to `end`, whole statements."""

    number: int
    begin: int
    end: int
    new: str


def change(number: int, mutant: Mutant, text: str) -> Change:
    """Find the statements that a mutant changes; `LookupError` if its line is not there once."""
    there = text.count(mutant.line)
    if there != 1 or mutant.line == mutant.broken:
        raise LookupError(f"{mutant.name}: its line is there {there} times")
    broken = text.replace(mutant.line, mutant.broken)
    begin = alike(text, broken)
    tail = min(
        alike(text[::-1], broken[::-1]),
        min(len(text), len(broken)) - begin,
    )
    end = len(text) - tail
    while end > begin and text[end - 1].isspace():
        end -= 1
    ends = boundaries(text)
    begin = max(at for at in ends if at <= begin)
    end = min(at for at in ends if at >= max(end, begin + 1))
    return Change(number, begin, end, broken[begin : len(broken) - (len(text) - end)])


def alike(one: str, other: str) -> int:
    """Count the characters that two texts begin with."""
    pairs = enumerate(zip(one, other, strict=False))
    return next((k for k, (a, b) in pairs if a != b), min(len(one), len(other)))


def boundaries(text: str) -> list[int]:
    """Places after each `;`, `{` and `}` that ends or opens statements."""
    ends: list[int] = []
    inside: list[str] = []
    for found in re.finditer(r"//[^\n]*|[;(){}\[\]]", text):
        sign, at = found[0], found.start()
        if sign in "([" or (sign == "{" and (inside or re.search(r"\w$|return $", text[:at][-7:]))):
            inside.append(sign)
        elif inside and sign in ")]}":
            inside.pop()
        elif not inside and sign in ";{}":
            ends.append(at + 1)
    return ends


def pieces(text: str) -> list[str]:
    """Split a statement at the commas that stand in no bracket."""
    found = [""]
    depth = 0
    for sign in text:
        depth += (sign in "([{") - (sign in ")]}")
        if sign == "," and not depth:
            found.append("")
        else:
            found[-1] += sign
    return found


def choice(old: str, changed: dict[int, str]) -> str:
    """Write an expression that is another one in some mutants."""
    ways = "".join(f"broken == {k} ? ({new}) : " for k, new in changed.items() if new != old)
    return f"({ways}({old}))"


def either(old: str, changed: dict[int, str]) -> str:
    """Write statements that are others in some mutants."""
    if declared := re.match(r"\s*(Node|const double|const int) ", old):
        if declared[1] == "Node":
            old, *news = (
                re.sub(r"next(\{.*\})", r"next = Node\1", x) for x in (old, *changed.values())
            )
            changed = dict(zip(changed, news, strict=True))
        parts = zip(pieces(old[:-1]), *(pieces(new[:-1]) for new in changed.values()), strict=True)
        return (
            ",".join(
                part.split(" = ", 1)[0]
                + " = "
                + choice(
                    part.split(" = ", 1)[1],
                    {k: new.split(" = ", 1)[1] for k, new in zip(changed, news, strict=True)},
                )
                for part, *news in parts
            )
            + ";"
        )
    if old.endswith("{"):
        inner = re.compile(r"\s*if \((.*)\) \{$", re.DOTALL)
        conditions = {k: inner.sub(r"\1", new) for k, new in changed.items()}
        condition = choice(inner.sub(r"\1", old), conditions)
        return f" if ({condition}) {{"
    ways = "".join(f" if (broken == {k}) {{ {new} }} else" for k, new in changed.items())
    return f"{ways} {{ {old} }}"


def breakable() -> dict[str, str]:
    """Write the sampler's files so that `broken`, a global number, makes a mutant of it."""
    texts = sources()
    for name, text in texts.items():
        changes = [
            change(k, m, text) for k, m in enumerate(MUTANTS) if f"mcmcda_{m.file}.hpp" == name
        ]
        groups: list[list[Change]] = []
        for c in sorted(changes, key=lambda c: (c.begin, -c.end)):
            if groups and c.begin < max(other.end for other in groups[-1]):
                groups[-1].append(c)
            else:
                groups.append([c])
        for group in reversed(groups):
            begin, end = min(c.begin for c in group), max(c.end for c in group)
            old = text[begin:end]
            news = {c.number: old[: c.begin - begin] + c.new + old[c.end - begin :] for c in group}
            texts[name] = texts[name][:begin] + either(old, news) + texts[name][end:]
    door = "NB_MODULE(_mcmcda, m) {"
    own = 'NB_MODULE(breakable, m) { m.def("break_line", [](int k) { broken = k; });'
    if door not in texts["mcmcda.cpp"]:
        raise LookupError(door)
    code = texts["mcmcda.cpp"].replace(door, own)
    return texts | {"mcmcda.cpp": f"inline int broken = -1;\n{code}"}


def build(folder: Path) -> ModuleType:
    """Compile and import the sampler that can be broken."""
    for name, text in breakable().items():
        (folder / name).write_text(text)
    include = Path(nanobind.include_dir())
    out = folder / "breakable.so"
    command = [
        *(
            "c++",
            "-std=c++20",
            "-O2",
            "-w",
            "-shared",
            "-fPIC",
            "-fvisibility=hidden",
            "-DNB_DOMAIN=mutants",
        ),
        *("-fno-strict-aliasing", "-ffp-contract=off"),
        f"-I{include}",
        f"-I{include.parent / 'ext' / 'robin_map' / 'include'}",
        f"-I{sysconfig.get_paths()['include']}",
        *(str(folder / "mcmcda.cpp"), str(include.parent / "src" / "nb_combined.cpp")),
        *("-o", str(out)),
    ]
    subprocess.run(command, check=True)  # noqa: S603 - our own files
    spec = importlib.util.spec_from_file_location(out.stem, out)
    if spec is None or spec.loader is None:
        raise ImportError(str(out))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Case(NamedTuple):
    """A test with one choice of its arguments, as pytest names it."""

    label: str
    given: dict[str, Any]
    run: Callable[[], None]


def cases(tests: ModuleType) -> list[Case]:
    """Every test with each of its arguments, the cheap ones first: on the smallest window."""
    found: list[Case] = []
    for name, function in vars(tests).items():
        if not name.startswith("test_"):
            continue
        marks: list[pytest.Mark] = getattr(function, "pytestmark", [])
        names = [mark.args[0] for mark in marks]
        for values in itertools.product(*(choices(mark) for mark in marks)):
            ids = "-".join(label for label, _ in values)
            given = dict(zip(names, (value for _, value in values), strict=True))
            label = f"{name}[{ids}]" if ids else name
            found.append(Case(label, given, partial(function, **given)))
    smallest, *others = tests.WINDOWS
    order = [smallest, None, *others]
    return sorted(
        found, key=lambda c: (order.index(c.given.get("name")), c.given.get("informed", False))
    )


def choices(mark: pytest.Mark) -> Iterator[tuple[str, Any]]:
    """Names and values of a parameter of tests."""
    values = list(mark.args[1])
    return zip(mark.kwargs.get("ids", map(str, values)), values, strict=True)


class Trial(NamedTuple):
    """A process that runs the tests with a mutant and writes the name of each before it begins."""

    number: int
    process: int
    names: int


def begin(tests: ModuleType, sampler: ModuleType, number: int) -> Trial:
    """Run the tests on a mutant until one fails, in a process of its own."""
    read, write = os.pipe()
    child = os.fork()
    if child:
        os.close(write)
        return Trial(number, child, read)
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_S, MOST_S))
    sampler.break_line(number)
    sys.modules["mcmcda_twin"].Sampler = sampler.Sampler  # type: ignore[attr-defined]
    for case in cases(tests):
        os.write(write, f"{case.label}\n".encode())
        try:
            case.run()
        except Exception:  # noqa: BLE001 - any failure is what we look for
            os._exit(1)
    os._exit(0)


def first_failure(trial: Trial) -> str:
    """Name of the first test that failed, or nothing."""
    with os.fdopen(trial.names) as lines:
        begun = lines.read().split()
    _, status = os.waitpid(trial.process, 0)
    return begun[-1] if status else ""


def load_tests() -> ModuleType:
    """Import the tests, and work out once what all mutants are held against."""
    sys.path.insert(0, str(ROOT / "tests"))
    tests = importlib.import_module("test_association_mcmcda_chain")
    for name in tests.WINDOWS:
        for informed in (False, True):
            tests.transitions(name, informed)
    return tests


def trials(chosen: list[int]) -> Iterator[tuple[int, str]]:
    """Numbers of mutants with the first test that fails, or nothing."""
    with tempfile.TemporaryDirectory() as folder:
        sampler = build(Path(folder))
        tests = load_tests()
        running: deque[Trial] = deque()
        for number in chosen:
            running.append(begin(tests, sampler, number))
            if len(running) == JOBS:
                yield running[0].number, first_failure(running.popleft())
        while running:
            yield running[0].number, first_failure(running.popleft())


def rewrite(page: str, killers: dict[str, str]) -> str:
    """Put what kills each mutant into the page's table; what was not tried stays."""
    before, after = page.split(BEGIN)[0], page.split(END)[1]
    known = dict(re.findall(r"^\| ([^|]+) \| `([^|]+)` \|$", page, re.MULTILINE)) | killers
    text = ""
    for kind, mutants in KINDS.items():
        text += f"\n\n| {kind} | noticed by |\n|---|---|"
        text += "".join(f"\n| {m.name} | `{known.get(m.name) or 'not run'}` |" for m in mutants)
    return f"{before}{BEGIN}{text}\n\n{END}{after}"


def main() -> int:
    """Try the mutants whose name has one of the words, or all."""
    reader = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    reader.add_argument("words", nargs="*", metavar="WORD")
    reader.add_argument("--page", action="store_true")
    given = reader.parse_args()
    words: list[str] = given.words
    chosen = [
        k for k, m in enumerate(MUTANTS) if not words or any(word in m.name for word in words)
    ]
    killers: dict[str, str] = {}
    for number, killer in trials([SOUND, *chosen]):
        if number == SOUND and killer:
            print(f"the source as it is fails {killer}")
            return 1
        if number != SOUND:
            killers[MUTANTS[number].name] = killer
            print(f"{MUTANTS[number].name}: {killer or 'LIVES'}", flush=True)
    if given.page:
        PAGE.write_text(rewrite(PAGE.read_text(), killers))
    killed = sum(map(bool, killers.values()))
    print(f"{killed} of {len(killers)} mutants killed")
    return killed < len(killers)


if __name__ == "__main__":
    sys.exit(main())
