"""Whoever starts a view without a bus is told so, once."""

import io

from headway.dashboard.contact import PATIENCE_S, ContactNotice


def test_what_is_not_there_is_said_once_and_its_return_too() -> None:
    out, now_s = io.StringIO(), [0.0]
    notice = ContactNotice("watch", ["tcp/a:1", "tcp/b:2"], to=out, now_s=lambda: now_s[0])

    def after(elapsed_s: float, *, connected: bool) -> str:
        before = out.tell()
        now_s[0] += elapsed_s
        notice.update(connected=connected)
        return out.getvalue()[before:]

    lost = "headway watch: no contact with tcp/a:1, tcp/b:2; is `headway serve` running? Waiting for it.\n"
    assert after(PATIENCE_S / 2, connected=False) == ""
    assert after(PATIENCE_S, connected=False) == lost
    assert after(60.0, connected=False) == ""
    assert after(1.0, connected=True) == "headway watch: connected to tcp/a:1, tcp/b:2\n"
    assert after(60.0, connected=True) == ""
    assert after(PATIENCE_S, connected=False) == lost


def test_a_connection_that_is_there_at_once_needs_no_word() -> None:
    out = io.StringIO()
    notice = ContactNotice("dashboard", (), to=out)
    notice.update(connected=True)
    assert out.getvalue() == ""
