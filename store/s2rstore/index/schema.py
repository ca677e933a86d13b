"""The index, as data: every table and column with its type and comment.

Missing values are SQL NULL, never NaN. Angles are radians, lengths metres.
"""

from __future__ import annotations

from collections.abc import Collection

from s2rstore.index.table_definition import Table, statements_of, table_of
from s2rstore.records import GAP_FACTORS

VERSION = 5
"""The schema number that every written index has, in `CURRENT.json`; others are refused.

A new table or column needs a new number.
"""

CHECKSUMS = "checksums"
"""Value of `provenance.what`: `key` is a file's path inside the store, `value` its SHA-256."""

LABELS = "labels"
"""Value of `provenance.what`: `key` is a domain with label images, `value` the key of their arrays.
"""

HEALTH = "health"
"""Value of `provenance.what`: `key` is a domain whose images `s2r check` has checked, `value` the
number of its images at that time."""

CONVENTIONS = "conventions"
"""Value of `provenance.what`: `key` is a domain, or DOMAIN@PART for the instances of an appended
part, `value` the check of its headings and depth."""

# Readable by every DuckDB release from 1.4 on.
STORAGE_VERSION = "v1.4.0"

_ADJUSTMENTS = (
    'JSON list of {"name", "value"}, applied in order; [] = untouched; '
    '"translate:NAME" also has the "sha256" of the translator'
)

TABLES: tuple[Table, ...] = (
    table_of(
        "dataset",
        "the one environment that this store holds",
        "name",
        ("name", "VARCHAR", "name of the environment"),
        (
            "hash",
            "VARCHAR",
            "SHA-256 over poses, frames and calibration; with rows in table part: SHA-256 over "
            "their hashes in order and those in table domain by name, joined",
        ),
        ("bounds_x0", "DOUBLE", "left edge of the floor plan, m"),
        ("bounds_y0", "DOUBLE", "edge of the floor plan with the smaller y, m"),
        ("bounds_x1", "DOUBLE", "right edge of the floor plan, m"),
        ("bounds_y1", "DOUBLE", "edge of the floor plan with the larger y, m"),
        ("y_down", "BOOLEAN", "true where y grows downward on the drawn floor plan"),
        ("floor_plan", "VARCHAR", "picture of the floor plan, path inside the store; NULL = none"),
        ("accuracy_scale", "DOUBLE", "S of accuracy = max(0, 1 - error / S), m"),
        ("frame_height", "INTEGER", "rows of every stored frame"),
        ("frame_width", "INTEGER", "columns of every stored frame"),
        (
            "has_poses",
            "BOOLEAN",
            "false: images without poses, depth, cameras and map, whose columns are NULL; "
            "NULL = true",
        ),
        (
            "recall_thresholds",
            "VARCHAR",
            "JSON list of [metres, degrees], ascending, within which recall counts a prediction; "
            "NULL = [[0.25, 2], [0.5, 5], [1, 10], [2, 20]]",
        ),
    ),
    table_of(
        "trajectory",
        "recordings; their instances follow one another within a part",
        "trajectory",
        ("trajectory", "VARCHAR", "name"),
        ("recorded_at", "VARCHAR", "when it was recorded, as the source states it"),
        ("instances", "INTEGER", "number of instances"),
    ),
    table_of(
        "room",
        "rectangles of the floor plan; a point in several belongs to the first by position",
        "position",
        ("room", "VARCHAR", "name; several rectangles may share it"),
        ("position", "INTEGER", "order of precedence"),
        ("x0", "DOUBLE", "m"),
        ("y0", "DOUBLE", "m"),
        ("x1", "DOUBLE", "m"),
        ("y1", "DOUBLE", "m"),
    ),
    table_of(
        "domain",
        "domains with their cameras at the stored frame size; table frame says which instances "
        "each of them images",
        "domain",
        ("domain", "VARCHAR", "name"),
        ("kind", "VARCHAR", "sim or real"),
        *(
            (f"{image}_{figure}", "DOUBLE", f"{image} camera: {comment}")
            for image in ("rgb", "depth")
            for figure, comment in (
                ("fx", "focal length in x, pixels of the stored frame"),
                ("fy", "focal length in y, pixels of the stored frame"),
                ("cx", "principal point in x; pixel i covers [i, i + 1)"),
                ("cy", "principal point in y; pixel i covers [i, i + 1)"),
                ("pitch", "upwards, rad"),
            )
        ),
        ("camera_height", "DOUBLE", "above the floor, m; NULL = unknown, without depth"),
        ("forward_offset", "DOUBLE", "camera ahead of the pose, m; negative = behind"),
        ("depth_scale", "DOUBLE", "metres per raw depth unit"),
        ("depth_raw_min", "INTEGER", "smallest valid raw depth"),
        ("depth_raw_max", "INTEGER", "largest valid raw depth"),
        ("source", "VARCHAR", "JSON: for each group of figures, declared or estimated"),
        (
            "has_depth",
            "BOOLEAN",
            "false: RGB images without depth, whose columns are NULL; NULL = true",
        ),
        (
            "hash",
            "VARCHAR",
            "SHA-256 over the frames and calibration of a domain that was added to the instances "
            "of a store; NULL = covered by the hashes of the parts",
        ),
    ),
    table_of(
        "instance",
        "one row per ground-truth pose or image, in order of part, trajectory and seq",
        "iid",
        ("iid", "INTEGER", "identity, 0 .. N-1"),
        ("trajectory", "VARCHAR", "recording"),
        (
            "seq",
            "INTEGER",
            "number in the trajectory, ascending: that of the manifest, else the position, from 0",
        ),
        ("x", "DOUBLE", "ground truth, m"),
        ("y", "DOUBLE", "ground truth, m"),
        ("heading", "DOUBLE", "ground truth, rad; forward = (cos, sin)"),
        ("room", "VARCHAR", "room of the ground truth; NULL = none"),
        (
            "curvature",
            "DOUBLE",
            "heading change from 3 instances before to 3 after, degrees",
        ),
        ("odom_x", "DOUBLE", "the robot's own odometry, in its own frame, m"),
        ("odom_y", "DOUBLE", "the robot's own odometry, in its own frame, m"),
        ("odom_heading", "DOUBLE", "the robot's own odometry, in its own frame, rad"),
        ("timestamp", "DOUBLE", "seconds; NULL = not recorded"),
        (
            "pair_offset_m",
            "DOUBLE",
            "distance between the poses of the sim and the real image, m; NULL = 0",
        ),
        (
            "pair_offset_deg",
            "DOUBLE",
            "angle between the headings of the sim and the real image, degrees; NULL = 0",
        ),
    ),
    table_of(
        "frame",
        "the source images of each instance in each domain; an instance has no image in a domain "
        "without a row. A domain images all or none of the instances of a trajectory and part",
        "domain iid",
        ("iid", "INTEGER", "instance"),
        ("domain", "VARCHAR", "domain"),
        ("rgb_path", "VARCHAR", "source file, relative to the ingested folder"),
        ("depth_path", "VARCHAR", "source file, relative to the ingested folder"),
        (
            "sha256",
            "VARCHAR",
            "SHA-256 over the bytes of both source files, RGB first; for images of recordings that "
            "of RGB without depth, with depth over the hexadecimal SHA-256 of RGB and of depth",
        ),
        ("valid_depth_fraction", "DOUBLE", "share of stored pixels with a valid depth"),
    ),
    table_of(
        "frame_pose",
        "poses of frames that were paired from recordings; a frame without a row has the pose of "
        "its instance",
        "domain iid",
        ("iid", "INTEGER", "instance"),
        ("domain", "VARCHAR", "domain"),
        ("x", "DOUBLE", "on the map, m"),
        ("y", "DOUBLE", "on the map, m"),
        ("heading", "DOUBLE", "on the map, rad; forward = (cos, sin)"),
        ("camera_x", "DOUBLE", "position of the camera in the recording's world, m"),
        ("camera_y", "DOUBLE", "position of the camera in the recording's world, m"),
        ("camera_z", "DOUBLE", "position of the camera in the recording's world, m"),
        *(
            (
                f"camera_q{axis}",
                "DOUBLE",
                "unit quaternion from the camera's axes (x right, y down, z forward) to the "
                "recording's world",
            )
            for axis in "xyzw"
        ),
    ),
    table_of(
        "label",
        "objects in label images; values of one name are instances of one class",
        "label",
        ("label", "INTEGER", "value of the object's pixels, 1 .. 65535"),
        ("name", "VARCHAR", "class"),
    ),
    table_of(
        "frame_label",
        "the objects that the label image of a frame shows; a frame without one has no rows",
        "domain iid label",
        ("iid", "INTEGER", "instance"),
        ("domain", "VARCHAR", "domain"),
        ("label", "INTEGER", "object"),
        ("share", "FLOAT", "share of the pixels that show it"),
    ),
    table_of(
        "frame_fault",
        "the faults of frames that `s2r check` found; a frame without one has no rows",
        "domain iid fault",
        ("iid", "INTEGER", "instance"),
        ("domain", "VARCHAR", "domain"),
        ("fault", "VARCHAR", "such as blurred or frozen"),
    ),
    table_of(
        "label_gain",
        "by how much the real error of a run would fall if a labelled object looked as in "
        "simulation: the sum of heatmap harm over the pixels that show it",
        "run iid label",
        ("run", "VARCHAR", "run"),
        ("iid", "INTEGER", "instance"),
        ("label", "INTEGER", "object"),
        ("gain", "DOUBLE", "m; negative = the error would rise"),
    ),
    table_of(
        "part",
        "instances that were ingested together, in order; without rows all instances are one part",
        "part",
        ("part", "INTEGER", "number, 0 .. P-1"),
        ("first_iid", "INTEGER", "instance with which the part begins"),
        ("instances", "INTEGER", "number of instances"),
        ("hash", "VARCHAR", "SHA-256 over poses, frames and calibration of its instances"),
        ("added_at", "VARCHAR", "UTC, ISO 8601; NULL = not recorded"),
    ),
    table_of(
        "model",
        "networks that runs use",
        "model",
        ("model", "VARCHAR", "name"),
        ("architecture", "VARCHAR", "registered architecture, or torchscript / module"),
        ("sha256", "VARCHAR", "of the weights file"),
        ("input_height", "INTEGER", "rows of the network's input"),
        ("input_width", "INTEGER", "columns of the network's input"),
        ("convention", "VARCHAR", "JSON: unit of the heading and frame of the output"),
        ("trained_by", "VARCHAR", "recipe and command; NULL = not by this program"),
        (
            "input",
            "VARCHAR",
            "JSON: how images become the network's input",
        ),
    ),
    table_of(
        "run",
        "one model applied to one sim and one real domain, each through its adjustments, or "
        "imported predictions for both",
        "created_at run",
        ("run", "VARCHAR", "name"),
        ("model", "VARCHAR", "model; NULL = the predictions were imported"),
        ("sim_domain", "VARCHAR", "domain of the sim side"),
        ("real_domain", "VARCHAR", "domain of the real side"),
        ("sim_adjustments", "VARCHAR", _ADJUSTMENTS),
        ("real_adjustments", "VARCHAR", _ADJUSTMENTS),
        ("key", "VARCHAR", "hash of all that the predictions depend on; NULL = not computed yet"),
        (
            "precision",
            "VARCHAR",
            "arithmetic of the predictions; NULL = not computed yet, or imported",
        ),
        ("created_at", "VARCHAR", "UTC, ISO 8601"),
    ),
    table_of(
        "prediction",
        "what each run predicts on each side; a row with a split but without a pose was not "
        "localised, one without a split was not asked for",
        "run side iid",
        ("run", "VARCHAR", "run"),
        ("iid", "INTEGER", "instance"),
        ("side", "VARCHAR", "sim or real"),
        ("x", "DOUBLE", "m"),
        ("y", "DOUBLE", "m"),
        ("heading", "DOUBLE", "rad"),
        (
            "sigma",
            "DOUBLE",
            "standard deviation of the position per axis, as the network states it, m; NULL = not "
            "stated",
        ),
        ("error", "DOUBLE", "distance to the ground truth, m"),
        ("heading_error", "DOUBLE", "smaller angle to the ground truth, rad"),
        ("loss", "DOUBLE", "0.7 error^2 + 0.3 heading_error"),
        ("accuracy", "DOUBLE", "max(0, 1 - error / accuracy_scale)"),
        (
            "rank",
            "INTEGER",
            "by error among the pairs of the run, trained ones included, 1 = smallest, ties by "
            "iid; NULL = no error, or an image of one side alone",
        ),
        (
            "split",
            "VARCHAR",
            "train, validation, test or unseen: what the model knew of it; NULL = the instance is "
            "not among those that the run was applied to",
        ),
        (
            "outlier",
            "DOUBLE",
            "mean distance to the nearest embeddings over the side's median; NULL = unknown",
        ),
        *(
            (
                f"share_{factor}",
                "FLOAT",
                f"real side: share of the gap due to {factor}, m; NULL = not computed",
            )
            for factor in GAP_FACTORS
        ),
    ),
    table_of(
        "projection",
        "joint UMAP of both sides' embeddings, one per run",
        "run side iid",
        ("run", "VARCHAR", "run"),
        ("iid", "INTEGER", "instance"),
        ("side", "VARCHAR", "sim or real"),
        ("u", "DOUBLE", "first UMAP coordinate"),
        ("v", "DOUBLE", "second UMAP coordinate"),
    ),
    table_of(
        "zarr_array",
        "published arrays, one for each part of the data set; value = (stored - zero) * scale",
        "run kind side mode path",
        ("run", "VARCHAR", "run"),
        ("kind", "VARCHAR", "what it holds: embedding, a heatmap kind, map grids, rendered frames"),
        ("side", "VARCHAR", "sim or real; NULL = both share it"),
        ("mode", "VARCHAR", "variant of the kind; NULL = only one"),
        ("path", "VARCHAR", "inside runs.zarr"),
        ("dtype", "VARCHAR", "numpy type"),
        ("shape", "VARCHAR", "JSON list"),
        ("axes", "VARCHAR", "JSON list of axis names"),
        ("scale", "DOUBLE", "see the table's comment"),
        ("zero", "DOUBLE", "see the table's comment"),
        ("unit", "VARCHAR", "of the real value"),
        ("metadata_sha256", "VARCHAR", "SHA-256 of its zarr.json"),
        ("first_iid", "INTEGER", "first instance that it covers; NULL = 0"),
    ),
    table_of(
        "translator",
        "fitted maps that make images of one domain look like those of another",
        "created_at translator",
        ("translator", "VARCHAR", "name"),
        ("method", "VARCHAR", "method of the fit"),
        ("direction", "VARCHAR", "sim2real or real2sim"),
        ("source_domain", "VARCHAR", "domain whose images it translates"),
        ("target_domain", "VARCHAR", "domain whose look it gives them"),
        ("sha256", "VARCHAR", "of its file in translators/"),
        ("accepted", "BOOLEAN", "whether it passed every check of its content; NULL = not checked"),
        ("reasons", "VARCHAR", "JSON list: why it is not accepted"),
        ("created_at", "VARCHAR", "UTC, ISO 8601"),
    ),
    table_of(
        "translator_metric",
        "how each translator was judged, on images that were not used for its fit",
        "translator metric reference run",
        ("translator", "VARCHAR", "translator"),
        ("metric", "VARCHAR", "name of the metric"),
        ("reference", "VARCHAR", "translator, or a control: identity, target, repeated_image"),
        ("run", "VARCHAR", "run whose model was used; NULL = none"),
        ("value", "DOUBLE", "estimate"),
        ("low", "DOUBLE", "95 % interval; NULL = unknown"),
        ("high", "DOUBLE", "95 % interval; NULL = unknown"),
        ("reason", "VARCHAR", "why a bound is NULL"),
        ("unit", "VARCHAR", "unit of value, low and high"),
    ),
    table_of(
        "row_file",
        "Parquet files that hold all rows of a table, which is then a view over them; a table "
        "without files holds its rows itself",
        "table_name run path",
        ("table_name", "VARCHAR", "table whose rows it holds"),
        ("run", "VARCHAR", "run whose rows it holds; NULL in a table without runs"),
        ("path", "VARCHAR", "relative to the folder of the index"),
        ("sha256", "VARCHAR", "of the file"),
        ("bytes", "BIGINT", "size of the file"),
        ("row_count", "BIGINT", "number of rows in the file"),
    ),
    table_of(
        "provenance",
        "provenance: versions, seeds, training curves, command lines",
        "what key",
        (
            "what",
            "VARCHAR",
            "dataset, model:NAME, run:NAME, translator:NAME, statistics, ...",
        ),
        ("key", "VARCHAR", "name of the figure"),
        ("value", "VARCHAR", "its value as text or JSON"),
    ),
)

BY_NAME: dict[str, Table] = {table.name: table for table in TABLES}

GAP_SHARES = tuple(f"share_{factor}" for factor in GAP_FACTORS)
"""Columns of table `prediction` with the shares of the gap."""
PAIR_OFFSETS = ("pair_offset_m", "pair_offset_deg")
"""Columns of table `instance` that are 0 where both images of a pair have the same pose."""


def statements(without: Collection[str] = ()) -> list[str]:
    """The SQL that makes the empty tables, comments included, apart from those `without`."""
    made = (table for table in TABLES if table.name not in without)
    return [statement for table in made for statement in statements_of(table)]
