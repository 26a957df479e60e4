"""What tests of the view ask of a page."""

import numpy as np


def ground(editor, x: float, y: float) -> np.ndarray:
    """The point of the ground under a pixel of the picture."""
    return np.array(editor.page.evaluate(f"pdOverlay.ground({x}, {y})"))


def tool(editor, start: str):
    """A button of the toolbar by the beginning of its hint."""
    return editor.page.get_by_role("toolbar", name="Tools").get_by_role(
        "button", name=start
    )


def ready(editor):
    """Wait for the overlay, at t = 0, with nothing over the picture."""
    editor.until(lambda: editor.tab().ui.overlay.is_ready, "the overlay")
    editor.go_to_now()
    editor.close_notifications()
    editor.settle()
    return editor


def camera_rests(editor) -> None:
    """Wait until the browser's camera stands still and the server knows where."""
    former = []

    def stands_still() -> bool:
        # A busy browser may draw nothing between two looks, and ease on later.
        editor.settle()
        camera = editor.client.camera
        now = np.concatenate([camera.position, camera.look_at, camera.up_direction])
        there = editor.page.evaluate(
            "(() => { const m = __viserMutable, c = m.camera.position.clone();"
            " m.nodeRefFromName[''].worldToLocal(c); return c.toArray(); })()"
        )
        former.append((now, np.array(there)))
        if len(former) < 3:
            return False
        (a, b), (c, d) = former[-2:]
        return (
            np.allclose(a, c, atol=1e-6)
            and np.allclose(b, d, atol=1e-6)
            and np.allclose(now[:3], there, atol=1e-2)
        )

    editor.until(stands_still, "the camera to rest")


def distance_m(editor) -> float:
    """How far the camera is from what it looks at."""
    camera = editor.client.camera
    return float(np.linalg.norm(camera.position - camera.look_at))
