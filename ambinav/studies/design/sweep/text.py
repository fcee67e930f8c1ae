"""Text of a sweep: words and numbers, rounded so that printed values agree with each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

from ambinav.ambiguity.model import PIECES_PER_TURN
from ambinav.drive.bootstrap import Interval
from ambinav.studies.design.sweep.figures import CRITERIA
from ambinav.studies.design.sweep.sweep import DIGITS, UNEVEN, SweepResult, is_open
from ambinav.studies.design.sweep.turning import WORTH, Turning
from ambinav.studies.design.sweep.vary import VARIABLES

_FEWEST = 3
"""Decimals of a level; a percentage has two less."""
_LISTED = 3
"""Number of neighbouring values from which their range is given."""
_ANY = "any"
BEAMS = "beams"
"""The variable whose fewer values need a reason."""


def where_text(result: SweepResult) -> str:
    """Describe the region."""
    kind, title = result.region.kind, result.region.title
    part = {"map": "", "polygon": f" within {title}", "route": f" along {title}"}[kind]
    return result.environment + part


def values_text(result: SweepResult, setting: int) -> tuple[str, ...]:
    """Format each variable's value in a setting and its twins: "60", "any", "60 to 180".

    No unit is printed.
    """
    grid = _grid_of_twins(result, setting)
    if grid is None:
        grid = [[value] for value in result.outcomes[setting].setting.values]
    return tuple(
        _listed(values, sorted(variation.values))
        for values, variation in zip(grid, result.variations, strict=True)
    )


def varied_text(value: float | None) -> str:
    """Format a variable's value of a document without its unit."""
    return "curve" if value is None else f"{value:.6g}"


def setting_text(result: SweepResult, setting: int) -> str:
    """Describe a setting and its twins: "aperture 60°, beams 20", "any yaw"."""
    texts = []
    for variation, value in zip(result.variations, values_text(result, setting), strict=True):
        variable = VARIABLES[variation.name]
        unit = {"deg": "°", "m": " m", "": ""}[variable.unit]
        texts.append(
            f"any {variable.title}" if value == _ANY else f"{variable.title} {value}{unit}"
        )
    text = ", ".join(texts)
    if _grid_of_twins(result, setting) is None:
        text += f" ({len(result.twins(setting)) - 1} more with the same beams)"
    return text


def _grid_of_twins(result: SweepResult, setting: int) -> list[list[float]] | None:
    """Return values of each variable in a setting and its twins; None if they form no grid."""
    twins = [result.outcomes[i].setting.values for i in result.twins(setting)]
    each = [sorted(set(column)) for column in zip(*twins, strict=True)]
    return each if math.prod(map(len, each)) == len(twins) else None


def _listed(values: list[float], every: list[float]) -> str:
    if len(values) > 1 and values == every:
        return _ANY
    first = every.index(values[0])
    if len(values) >= _LISTED and every[first : first + len(values)] == values:
        return f"{values[0]:.6g} to {values[-1]:.6g}"
    return ", ".join(f"{value:.6g}" for value in values)


@dataclass(frozen=True)
class Numbers:
    """Formatter of levels, or of shares in percent, with decimals that keep sentences true.

    Margins are differences of the numbers that are printed, not of those behind them.

    Attributes:
        digits: Decimals of a level or a share of 1.
        percent: Whether they are shares, printed as percentages.
    """

    digits: int
    percent: bool = False

    def value(self, value: float) -> str:
        """Format a figure with its unit."""
        return "unknown" if math.isnan(value) else self._plain(value) + " %" * self.percent

    def shown(self, value: float | None) -> str:
        """Format a figure of a document; "-" if it has none."""
        return "-" if value is None else self.value(value)

    def difference(self, more: float, less: float, margin: Interval) -> str:
        """Format the difference of two figures, with the margin's interval if it has one."""
        if math.isnan(more) or math.isnan(less):
            return "unknown"
        value = self._round(more) - self._round(less)
        text = self._plain(value)
        if margin.high > margin.low and math.isfinite(margin.high):
            low, high = min(self._round(margin.low), value), max(self._round(margin.high), value)
            text += f" [{self._end(margin.low, low)}, {self._end(margin.high, high)}]"
        return text + " points" * self.percent

    def interval(self, value: float, interval: Interval) -> str:
        """Format a figure with its interval, if it has one."""
        text = self.value(value)
        if interval.high > interval.low and math.isfinite(interval.high):
            lowest = max(interval.low, 0.0)
            text += f" [{self._plain(lowest)}, {self._plain(min(interval.high, 1.0))}]"
        return text

    def tells(self, values: Iterable[float]) -> bool:
        """Return whether exactly the values that are 0 print as 0."""
        return all((self._round(value) == 0.0) == (round(value, DIGITS) == 0.0) for value in values)

    def _end(self, exact: float, rounded: float) -> str:
        """Format an end of an interval with enough decimals that only 0 prints as 0."""
        for digits in range(self.digits, DIGITS):
            finer = Numbers(digits, self.percent)
            if rounded != 0.0 or finer.tells([exact]):
                return finer._plain(exact if rounded == 0.0 else rounded)
        return Numbers(DIGITS, self.percent)._plain(exact)

    def _plain(self, value: float) -> str:
        scale, digits = (100.0, self.digits - 2) if self.percent else (1.0, self.digits)
        return f"{round(scale * self._round(value), digits) + 0.0:.{digits}f}"

    def _round(self, value: float) -> float:
        return round(round(value, DIGITS), self.digits)


@dataclass(frozen=True)
class Words:
    """Texts of a report on a sweep."""

    result: SweepResult

    @cached_property
    def numbers(self) -> Numbers:
        """Formatter for the criterion; settings that differ from the best differ as printed."""
        result = self.result
        others = [*result.order[1:], None]
        margins = [margin for margin in map(result.margin, others) if not math.isnan(margin.value)]
        best = result.best.figures.of(result.criterion)
        figures = [margin.value + round(best, DIGITS) for margin in margins]
        for digits in range(_FEWEST, DIGITS + 1):
            numbers = Numbers(digits, result.criterion == "bad")
            apart = (
                round(figure, digits) - round(round(best, DIGITS), digits) for figure in figures
            )
            same = all(
                (abs(gap) < 1e-9) == (abs(margin.value) < 1e-9)
                for gap, margin in zip(apart, margins, strict=True)
            )
            if same:
                break
        return numbers

    @property
    def best_value(self) -> str:
        """Figure of the best setting, with its interval."""
        result = self.result
        return self.numbers.interval(result.best.figures.of(result.criterion), result.best_interval)

    def margin(self, setting: int | None) -> str:
        """Format the advantage of the best setting over another one; None: over the present one."""
        result = self.result
        other = result.present if setting is None else result.outcomes[setting]
        more, less = (outcome.figures.of(result.criterion) for outcome in (other, result.best))
        return self.numbers.difference(more, less, result.margin(setting))

    @property
    def best(self) -> str:
        """Description of the best setting."""
        return setting_text(self.result, self.result.order[0])

    @property
    def summary(self) -> str:
        """Summary of the result in a few sentences."""
        result, title = self.result, CRITERIA[self.result.criterion]
        count, different = len(result.outcomes), len(result.order)
        where = f"{result.scanner.name} in {where_text(result)}"
        if count == 1:
            text = [f"{where} with {self.best}: {title} {self.best_value}."]
        elif different == 1:
            every = "Both" if count == 2 else f"All {count}"
            text = [
                f"{every} settings of {where} have the same beams in the map: {title} "
                f"{self.best_value}."
            ]
        else:
            distinct_text = (
                "" if different == count else f", {different} of them with different beams,"
            )
            text = [
                f"Of {count} settings of {where}{distinct_text} the best is {self.best}: {title} "
                f"{self.best_value}."
            ]
            text += [*self._fits(), self._next(), *self._fewer_beams()]
        text.append(self._present())
        yaw_varies = any(variation.name == "yaw" for variation in result.variations)
        if yaw_varies and not result.scanner.looks_all_around:
            text.append(f"Headings of the robot: {result.headings}.")
        if result.turning is not None and len(result.turning.yaws) > 1:
            text.append(self._turning(result.turning))
        return " ".join(text)

    def _fits(self) -> list[str]:
        """Return a warning, in a sentence, if the best setting fits on less floor than another."""
        standing, most = self.result.best.figures.standing, self.result.most_standing
        if most - standing <= UNEVEN:
            return []
        return [
            f"That is of the {share_text(standing)} of the region where the robot fits with it; "
            f"with others it fits on up to {share_text(most)}."
        ]

    def _next(self) -> str:
        result = self.result
        second = result.order[1]
        name, open_ = setting_text(result, second), len(result.as_good) - 1
        if math.isnan(result.margin(second).value):
            return "With every other setting the robot fits nowhere there."
        if result.margin(second).value == 0.0:
            same = sum(result.margin(i).value == 0.0 for i in result.order[1:])
            by_mean = result.criterion != "mean" and round(
                result.outcomes[second].figures.mean - result.best.figures.mean, DIGITS
            )
            text = (
                f"{same} {'others have' if same > 1 else 'other has'} the same figure"
                f"{', and a higher mean level' if by_mean else f', such as {name}'}."
            )
        else:
            text = f"It is {self.margin(second)} below the next, {name}."
        if result.levels.places.is_sample and not math.isnan(result.margin(second).low) and open_:
            text += (
                " The evaluated places do not distinguish the best from "
                f"{'this one' if result.as_good[1:] == (second,) else f'{open_} others'}."
            )
        return text

    def _fewer_beams(self) -> list[str]:
        """Return the reason, in a sentence, if the best setting has fewer beams than another."""
        result = self.result
        names = [variation.name for variation in result.variations]
        if BEAMS not in names:
            return []
        column = names.index(BEAMS)
        best = result.best.setting.values
        more = [
            i
            for i in result.order[1:]
            for values in (result.outcomes[i].setting.values,)
            if values[column] > best[column]
            and values[:column] + values[column + 1 :] == best[:column] + best[column + 1 :]
            and not math.isnan(result.margin(i).value)
        ]
        if not more:
            return []
        name = setting_text(result, more[0])
        if is_open(result.margin(more[0])):
            return [
                f"That more beams ({name}) do worse is not shown: prefer fewer for their price "
                "alone."
            ]
        return [
            f"More beams ({name}) do worse by {self.margin(more[0])}: however many there are, a "
            f"scan counts as {PIECES_PER_TURN:g} independent ones a turn, so each of fewer beams "
            "has more weight, and these meet more of what tells the position."
        ]

    def _present(self) -> str:
        result = self.result
        margin, figures = result.margin(None), result.present.figures
        if result.present_is_best:
            return "The present scanner is equally good: it has the same beams."
        if math.isnan(margin.value):
            return "With the present scanner the robot fits nowhere there."
        value = self.numbers.value(figures.of(result.criterion))
        if margin.value == 0.0:
            return f"The present scanner has {value} too."
        open_ = not math.isnan(margin.low) and is_open(margin)
        caveat = ", a difference that the evaluated places do not show" if open_ else ""
        if margin.value > 0.0:
            return f"The present scanner has {value}: {self.margin(None)} above the best{caveat}."
        best, present = (
            outcome.figures.of(result.criterion) for outcome in (result.best, result.present)
        )
        less = Interval(-margin.value, -margin.high, -margin.low, margin.count)
        amount = self.numbers.difference(best, present, less)
        return (
            f"The present scanner is better: it has {value}, {amount} below the best setting "
            f"tried{caveat}."
        )

    @property
    def formats(self) -> tuple[Callable[[float | None], str], Callable[[float | None], str]]:
        """Formatters of the levels and of the shares in the document."""
        by, other = self.numbers, Numbers(3, percent=not self.numbers.percent)
        levels, shares = (other, by) if by.percent else (by, other)
        return levels.shown, shares.shown

    def turning_numbers(self, turning: Turning) -> Numbers:
        """Return a formatter that prints a gain as large as the advice takes it to be."""
        fewest = _FEWEST if self.result.criterion == "bad" else self.numbers.digits
        for digits in range(fewest, DIGITS + 1):
            numbers = Numbers(digits)
            if numbers.tells([turning.gain.low - WORTH, turning.gain.value]):
                break
        return numbers

    def _turning(self, turning: Turning) -> str:
        numbers = self.turning_numbers(turning)
        fixed, turned = turning.fixed_mean, turning.turned_mean
        advice = (
            "turning the scanner is worth it" if turning.is_worth_it
            else "leave the scanner fixed"
        )  # fmt: skip
        where = (
            "" if turning.standing > 1.0 - 1e-9
            else f", over the {share_text(turning.standing)} of the region where it fits with all "
            "of them"
        )  # fmt: skip
        return (
            f"Turned to the best of {len(turning.yaws)} yaws at each place it would have a mean "
            f"level of {numbers.value(turned)} instead of {numbers.value(fixed)} with a fixed yaw "
            f"of {turning.yaws[turning.fixed]:g}°{where}, a gain of "
            f"{numbers.difference(fixed, turned, turning.gain)}: {advice}."
        )


def share_text(share: float) -> str:
    """Format a share of 1 as a percentage that prints 0 or 100 only where it is exact."""
    for digits in range(1, DIGITS - 1):
        if (round(100.0 * share, digits) in (0.0, 100.0)) == (share in (0.0, 1.0)):
            break
    return f"{100.0 * share:.{digits}f} %"
