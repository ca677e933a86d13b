"""The query input: completion at the cursor and quoted names."""

from textual import events

from s2rtui.app.widgets.query_input import QueryInput
from tests.support.application import press, running


async def test_completion_at_the_cursor(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "slash")
        line = app.query_one(QueryInput)
        for typed, completed in (
            ("wor^", "worst15^"),
            ("room:le^ & curved", 'room:"left hall"^ & curved'),
            ("cur^ved & all", "curved^ & all"),
            ("!str^aight | worst15", "!straight^ | worst15"),
            ("real.error > ^ & all", "real.error > ^ & all"),
            ("straight & heading ^", "straight & heading >^"),
            ('curved & room:"left h^', 'curved & room:"left hall"^'),
        ):
            line.value, line.cursor_position = typed.replace("^", ""), typed.index("^")
            await pilot.press("tab")
            await pilot.pause()
            assert line.value == completed.replace("^", "")
            assert line.cursor_position == completed.index("^")
        line.cursor_position = 3
        await pilot.press("ctrl+u")
        assert line.value == ""
        line.value, line.cursor_position = "room: & all", 5
        values = []
        for _ in range(3):
            await pilot.press("tab")
            await pilot.pause()
            values.append(line.value)
        assert values == ['room:"left hall" & all', "room:right & all", 'room:"left hall" & all']
        assert 'room:"left hall" (room)  room:right (room)' in app.session.state.message
        for change in ("paste", "click"):  # edits between two completions are kept
            line.value, line.cursor_position = "room:", 5
            await pilot.press("tab")
            if change == "paste":
                line.post_message(events.Paste(" & wor"))
                await pilot.pause()
                expected = 'room:"left hall" & worst15'
            else:
                line.value, line.cursor_position = 'wor & room:"left hall"', 3
                expected = 'worst15 & room:"left hall"'
            await pilot.press("tab")
            await pilot.pause()
            assert line.value == expected


async def test_a_saved_name_is_quoted_and_a_hint_ends_with_its_input(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "at", *"two", "space", *"words", "enter")
        message = app.session.state.message
        assert message == 'saved as @"two words"'
        app.session.select(message.removeprefix("saved as "))
        assert not app.session.state.is_error
        await press(app, pilot, "F")
        assert ".parquet" in app.session.state.message
        await press(app, pilot, "escape")
        assert app.session.state.message == ""
