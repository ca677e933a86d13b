"""Reducers of images: the sides of the instance view, and the thumbnails of the sheet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rtui.session import instance_list
from s2rtui.session.context import SessionContext
from s2rtui.session.state import ARRANGEMENTS, PICTURES, Picture, State
from s2rtui.user_data.notebook import Notes

COUNTS = (6, 12, 24, 48, 96)
"""Numbers of thumbnails of a page."""
_STEP = 0.1
"""Share of the width by which a key moves the divider."""
_ARRANGED = {
    "beside": "both sides beside each other",
    "blink": "both sides in turn",
    "slide": "sim left of the divider, real right of it (< > move it)",
}


def _with(state: State, message: str, **fields: object) -> State:
    return state.updated(images=replace(state.images, **fields), message=message)  # type: ignore[arg-type]


def change_arrangement(context: SessionContext, state: State) -> State:
    """Show both sides beside each other, in turn, or with a divider in one image."""
    present = ARRANGEMENTS.index(state.images.arrangement)
    arrangement = ARRANGEMENTS[(present + 1) % len(ARRANGEMENTS)]
    return _with(state, _ARRANGED[arrangement], arrangement=arrangement)


def swap_front(context: SessionContext, state: State) -> State:
    """Show the other side where sides are shown in turn; the message stays."""
    images = state.images
    return replace(state, images=replace(images, front="real" if images.front == "sim" else "sim"))


def move_divider(context: SessionContext, state: State, steps: int) -> State:
    """Move the divider between both sides to the right by some steps."""
    return place_divider(context, state, state.images.divider + steps * _STEP)


def place_divider(context: SessionContext, state: State, share: float) -> State:
    """Place the divider at a share (0 .. 1) of the width of the image."""
    if state.images.arrangement != "slide":
        return state.with_message("there is a divider where both sides are in one image (\\)")
    return _with(state, "", divider=min(max(round(share, 3), 0.0), 1.0))


def change_picture(context: SessionContext, state: State) -> State:
    """Show other thumbnails: the real images, those of sim, their differences, heat."""
    pictures = PICTURES if state.shown_heat is not None else PICTURES[:-1]
    picture = pictures[(pictures.index(shown_picture(state)) + 1) % len(pictures)]
    text = {"difference": "differences of both sides, black: equal", "heat": _heat_text(state)}
    return _with(state, f"thumbnails: {text.get(picture, f'{picture} images')}", picture=picture)


def shown_picture(state: State) -> Picture:
    """What the thumbnails show: images of the side in place of heat where none is drawn."""
    picture = state.images.picture
    return state.side if picture == "heat" and state.shown_heat is None else picture


def _heat_text(state: State) -> str:
    heat = state.shown_heat
    return f"{heat.label} on {heat.side} images" if heat is not None else ""


def change_count(context: SessionContext, state: State, steps: int) -> State:
    """Show fewer or more thumbnails on a page."""
    at = min(max(COUNTS.index(state.images.count) + steps, 0), len(COUNTS) - 1)
    return _with(state, f"{COUNTS[at]} thumbnails on a page", count=COUNTS[at])


def turn_page(context: SessionContext, state: State, pages: int) -> State:
    """Move the cursor by some pages of the sheet."""
    return instance_list.move(context, state, pages * state.images.count)


def sheet_order(store: Store, state: State) -> NDArray[np.intp]:
    """The selected iids in the order of the sheet: that of the list, without remarks."""
    if state.sort == instance_list.REMARK:
        state = replace(state, sort="iid", descending=False)
    return instance_list.order(store, state, Notes())


def page_number(iids: NDArray[np.intp], state: State) -> int:
    """The page, from 0, that holds the cursor; the first one where none does."""
    places = np.flatnonzero(iids == state.cursor) if state.cursor is not None else iids[:0]
    return int(places[0]) // state.images.count if places.size else 0


def page(store: Store, state: State) -> NDArray[np.intp]:
    """The iids of the page that is shown."""
    iids = sheet_order(store, state)
    first = page_number(iids, state) * state.images.count
    return iids[first : first + state.images.count]


def page_key(store: Store, state: State) -> tuple[object, ...]:
    """Everything that the thumbnails of the page depend on."""
    picture = shown_picture(state)
    heat = state.shown_heat if picture == "heat" else None
    return state.generation, state.run, picture, heat, *page(store, state).tolist()
