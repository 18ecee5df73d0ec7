"""The files of a calibration: report.html, calibration.csv and .json, runs.csv, and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichi_foam.calibration import charts
from taichi_foam.calibration.outcome import AS_WIDE, LEVELS, TOGETHER, Calibration, Parameter
from taichi_foam.calibration.posterior import DISCREPANCY, RULED_OUT
from taichi_foam.calibration.runs import joined
from taichi_foam.formulas.traces import channel
from taichi_foam.picture import document, style
from taichi_foam.results.files import write_csv, write_json, write_rows

REPORT, TABLE, WHOLE, RUNS = "report.html", "calibration.csv", "calibration.json", "runs.csv"
FIGURES = "figures"


def write_folder(found: Calibration, folder: Path) -> None:
    """Write all files of a calibration into a folder. Raises UserError, OSError."""
    write_rows(folder / TABLE, found.table)
    write_csv(folder / RUNS, _runs_table(found))
    write_json(folder / WHOLE, content(found))
    (folder / FIGURES).mkdir()
    for name, figure in _figures(found).items():
        style.save_all(figure, folder / FIGURES / name)
    write(found, folder / REPORT)


def content(found: Calibration) -> dict[str, Any]:
    """Everything that a calibration says, as plain data: `calibration.json`. SI."""
    discrepancy = found.discrepancy
    return {
        "scene": found.scene.name,
        "parameters": found.table,
        "correlation": found.correlation,
        "figures": [
            {
                "name": name,
                "measured": found.target.measured[k],
                "deviation": np.sqrt(found.target.covariance[k, k]),
                "emulator_explains": found.target.emulator.explained[k],
                "influence": dict(zip(found.space.keys, found.influence[k], strict=True)),
            }
            for k, name in enumerate(found.names)
        ],
        "discrepancy": {
            "estimated": found.given is None,
            "low_5": discrepancy[0],
            "median": discrepancy[1],
            "high_95": discrepancy[2],
        },
        "filter": found.reading and channel(found.reading.reader.channel_class),
        "held_out_inside_90": found.held_out,
        "measured_inside_band": found.inside_band,
        "checks": _checks(found),
        "waves": [
            {"runs": len(runs), "failed": int(runs.failed.sum()), "not_ruled_out": left}
            for runs, left in zip(found.runs, found.left, strict=True)
        ],
        "chain": {
            "samples": len(found.samples),
            "independent": found.posterior.independent,
            "accepted": found.posterior.accepted,
        },
        "notes": found.notes,
    }


def write(found: Calibration, path: str | Path) -> Path:
    """Write the report as one HTML file, and return its path. Raises UserError."""
    sections = [
        document.Section(
            "Parameters",
            [
                "Ranges hold the parameters with 90 % probability (5-95 %), given the trace, its "
                "noise, the scatter of the runs, what the emulator does not know, and what the "
                "model lacks. There is no single best value: use the samples, or the ends.",
                *_undetermined(found.parameters),
            ],
            charts.posterior(found),
            "Posterior of each parameter and of each pair, over the ranges that were searched",
            "Dashed: the prior. A histogram as flat as the prior says that the data do not tell.",
            document.Table(
                ("parameter", "unit", "searched", "5-95 %", "median", "width over prior", ""),
                [
                    (
                        each.key,
                        each.unit,
                        f"{each.prior[0]:.4g} to {each.prior[1]:.4g}",
                        f"{each.low:.4g} to {each.high:.4g}",
                        f"{each.median:.4g}",
                        f"{each.width:.2f}",
                        each.verdict,
                    )
                    for each in found.parameters
                ],
            ),
        ),
        *_correlations(found),
        *_predicted(found),
        _figures_section(found),
        _held_out(found),
        _method(found),
    ]
    sure = sum(each.is_determined for each in found.parameters)
    lead = [
        f"Parameters of the scene {found.scene.name} from "
        + ("a measured trace" if found.reading else "measured key figures")
        + f": {sure} of {len(found.parameters)} are determined by the data.",
        *(
            f"{each.key}: {each.low:.4g} to {each.high:.4g}"
            f"{f' {each.unit}' if each.unit not in ('-', '') else ''} ({each.verdict})."
            for each in found.parameters
        ),
    ]
    return document.write(path, f"Calibration of {found.scene.name}", lead, sections)


def _figures(found: Calibration) -> Mapping[str, Any]:
    figures = {"posterior": charts.posterior(found), "emulator": charts.errors(found)}
    if found.reading is not None:
        figures["trace"] = charts.trace(found)
    return figures


def _undetermined(parameters: Sequence[Parameter]) -> list[str]:
    """What is to be said of parameters that the data do not determine."""
    words = []
    for each in parameters:
        if each.verdict == "not determined":
            words.append(
                f"{each.key} is not determined: its interval is {100 * each.width:.0f} % as wide "
                "as that of the prior. The median says nothing; measure something that depends on "
                "it, or fix it from another source."
            )
        elif each.verdict.startswith("only together"):
            words.append(
                f"{each.key} is determined {each.verdict}: a change of one makes up for a change "
                "of the other. Fix one of them from another source."
            )
        elif not each.is_determined:
            words.append(
                f"{each.key} leans on the end of its range ({each.verdict}): widen the range, or "
                "doubt the scene."
            )
    return words


def _correlations(found: Calibration) -> list[document.Section]:
    keys = found.space.keys
    if len(keys) < 2:
        return []
    rows = [
        (key, *(f"{value:+.2f}" for value in row))
        for key, row in zip(keys, found.correlation, strict=True)
    ]
    words = [
        f"From {TOGETHER:g} on (either sign) two parameters are determined only in combination."
    ]
    return [
        document.Section("Correlations", words, table=document.Table(("", *keys), rows)),
    ]


def _predicted(found: Calibration) -> list[document.Section]:
    if found.reading is None or found.inside_band is None:
        return []
    rows = [
        (name, f"{each['measured']:.4g}", f"{each['low_5']:.4g} to {each['high_95']:.4g}")
        for name, each in _checks(found).items()
    ]
    return [
        document.Section(
            "Predicted trace",
            [
                f"{len(found.predicted)} runs at samples of the posterior, "
                f"{found.predicted.failed.sum()} of which failed. The wider band holds "
                f"{100 * found.inside_band:.0f} % of the trace; it should hold about 90 %. "
                f"All traces went through the filter {channel(found.reading.reader.channel_class)} "
                "(SAE J211), and begin where they first exceed "
                f"{100 * found.reading.reader.onset:.0f} % of their peak.",
            ],
            charts.trace(found),
            "Measured deceleration over time, and the band of runs at samples of the posterior",
            "Dotted: ends of the intervals whose means are compared.",
            document.Table(
                ("not compared", "measured", "runs, 5-95 %"),
                rows,
                "These figures were not used to determine the parameters, but follow from the same "
                "trace.",
            ),
        )
    ]


def _figures_section(found: Calibration) -> document.Section:
    target = found.target
    rows = [
        (
            name,
            f"{target.measured[k]:.4g}",
            f"{np.sqrt(target.covariance[k, k]):.2g}",
            f"{100 * target.emulator.explained[k]:.0f} %",
            *(f"{100 * part:.0f} %" for part in found.influence[k]),
        )
        for k, name in enumerate(found.names)
    ]
    return document.Section(
        "What determines them",
        [
            "The peak and the means over equal intervals of the filtered trace (m/s²), and key "
            "figures (SI) if there are any. The last columns say which part of a figure's variance "
            "over the last emulator's ranges each parameter alone explains: a parameter that "
            "explains little of every figure cannot be determined by them.",
        ],
        table=document.Table(
            ("figure", "measured", "error", "emulated", *found.space.keys),
            rows,
            "Emulated: part of the variance between the runs that is predicted when each is left "
            "out; the rest is scatter between runs, or unknown.",
        ),
    )


def _held_out(found: Calibration) -> document.Section:
    rows = [(name, f"{100 * part:.0f} %") for name, part in found.held_out.items()]
    return document.Section(
        "Held out",
        [
            "Each run was left out once and predicted from the others, and the runs at samples of "
            "the posterior were not used for the emulator at all. About 90 % of the figures should "
            "lie within their predicted 90 % intervals; more is cautious, clearly less means that "
            "intervals of parameters are too narrow.",
        ],
        charts.errors(found),
        "Errors of the emulator in predicted deviations, for each figure",
        "Lines: 90 % of the errors should be between them.",
        document.Table(("figures within 90 % intervals", "part"), rows),
    )


def _method(found: Calibration) -> document.Section:
    low, middle, high = 100 * found.discrepancy
    if found.given is None:
        lacking = (
            "Model discrepancy, a term of its own: estimated with the parameters as "
            f"{low:.1f} to {high:.1f} % of the figures (median {middle:.1f} %); its prior is half "
            f"normal with a scale of {100 * DISCREPANCY:g} %. Where it is large, the model does "
            "not follow the trace for any parameters in the ranges."
        )
    else:
        lacking = f"Model discrepancy: given, {100 * found.given:g} % of the figures."
    waves = [
        f"Wave {wave}: {len(runs)} runs, {runs.failed.sum()} failed; after it "
        f"{100 * left:.3g} % of the ranges were not ruled out (implausibility up to {RULED_OUT:g})."
        for wave, (runs, left) in enumerate(zip(found.runs, found.left, strict=True), 1)
    ]
    return document.Section(
        "Discrepancy, waves, notes",
        [
            lacking,
            *waves,
            f"Posterior: emcee, {len(found.samples):,} samples worth about "
            f"{found.posterior.independent:.0f} independent ones; flagged as not determined from "
            f"{100 * AS_WIDE:g} % of the prior's width on.",
            *(f"Note: {note}." for note in found.notes),
        ],
    )


def _checks(found: Calibration) -> dict[str, dict[str, float]]:
    """Figures that were not compared: measured, and of the runs at samples of the posterior."""
    if found.reading is None:
        return {}
    reader = found.reading.reader
    measured = reader.checks(found.reading.series)
    predicted = reader.checks(found.predicted.traces)
    found_rows = {}
    for name in measured:
        low, _, high = np.quantile(predicted[name], LEVELS)
        found_rows[name] = {"measured": float(measured[name]), "low_5": low, "high_95": high}
    return found_rows


def _runs_table(found: Calibration) -> dict[str, list[Any]]:
    """All runs: wave, parameters, figures, and why a run failed."""
    parts = [*found.runs, found.predicted]
    waves = [*range(1, len(found.runs) + 1), "predicted"]
    whole = joined(parts)
    figures = whole.figures(found.reading and found.reading.reader)[:, found.kept]
    return {
        "wave": [wave for wave, part in zip(waves, parts, strict=True) for _ in range(len(part))],
        **{key: whole.values[:, d].tolist() for d, key in enumerate(found.space.keys)},
        **{name: figures[:, k].tolist() for k, name in enumerate(found.names)},
        "failure": [reason or "" for reason in whole.failures],
    }
