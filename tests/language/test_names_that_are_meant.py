"""An unknown name of a field or a column says which one is meant."""

import pytest

import s2rstore
from s2rstore.errors import ExpressionError, RequestError
from s2rstore.language import fields
from s2rstore.language.parser import parse


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("heading_rad > 1", "could be heading_deg"),
        ("real_error > 1", "could be real.error_m"),
        ("real.error_rad > 1", "could be real.error_m"),
        ("real_error", "could be real.error_m > 1"),
        ("real_room:kitchen", "could be real.room"),
        ("trajectory:traj1", "could be traj"),
    ],
)
def test_an_expression_names_the_field_alone(text, hint):
    with pytest.raises(ExpressionError) as error:
        parse(text)
    assert str(error.value).endswith(hint)


def test_an_expression_takes_the_columns_of_rows():
    for name in fields.NUMERIC:
        assert parse(f"{fields.column_of(name)} > 1") == parse(f"{name} > 1")
    columns = parse('worst(5%, sim_heading_error_deg) & run("b").real_error_m:1..2')
    assert columns == parse('worst(5%, sim.heading_error) & run("b").real.error:1..2')


def test_every_field_is_meant_by_its_own_name():
    for name in (*fields.NUMERIC, *fields.TEXT):
        field = fields.meant(name.replace(".", "_"))
        assert field is not None
        assert fields.without_unit(field) == name or name.startswith("pair_offset")


def test_columns_of_rows_and_of_scripts_name_it(tiny_store, s2r):
    s2r("query", tiny_store, "all", "--columns", "iid,real_error").assert_refused(
        "--columns real_error: no such field; real.error_m is meant"
    )
    with s2rstore.open(tiny_store) as store:
        with pytest.raises(AttributeError, match="no column heading_deg; heading is meant"):
            _ = store.instances.heading_deg  # type: ignore[attr-defined]
        with pytest.raises(AttributeError, match=r"real_error_m; real\.error is meant"):
            _ = store.run_columns(next(iter(store.runs))).real_error_m  # type: ignore[attr-defined]
        with pytest.raises(AttributeError, match=r"no column nonsense \(has: x, y, heading"):
            _ = store.instances.nonsense  # type: ignore[attr-defined]


def test_exchanged_arguments_of_frames_are_named(tiny_store):
    with s2rstore.open(tiny_store) as store:
        assert store.frame("sim", 0).rgb.ndim == 3
        with pytest.raises(RequestError, match=r"frame\(domain, iid\): names are texts"):
            store.frame(0, "sim")  # type: ignore[arg-type]
        for arguments in ((0, 1, "sim"), (0, "sim", 1), ("sim", "0", "1")):
            with pytest.raises(RequestError, match=r"frames\(domain, start, stop\): names are"):
                store.frames(*arguments)  # type: ignore[arg-type]
        with pytest.raises(RequestError, match=r"heatmaps\(run, kind, side, start, stop\): names"):
            store.heatmaps("vanilla", "occlusion", 0, 1, "sim")  # type: ignore[arg-type]
        with pytest.raises(RequestError, match="side 'vanilla': sim or real"):
            store.accuracies("sim", "vanilla")  # type: ignore[arg-type]
