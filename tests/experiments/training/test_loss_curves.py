import struct

from pd_editor.experiments.training.monitoring import loss_curves_png


def entry(minutes, loss, *, held_out=False, **parts):
    return {"minutes": minutes, "loss": loss, "held_out": held_out, "parts": parts}


def size_of(png):
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", png[16:24])


def test_each_part_has_its_own_axes():
    one = [entry(k, 1 / (1 + k), a=1.0) for k in range(5)]
    more = [entry(k, 1 / (1 + k), a=1.0, b=0.0, c=2.0, d=3.0) for k in range(5)]
    checked = [entry(4, 0.5, held_out=True, a=1.0)]
    (width, height), (wide, high) = map(
        size_of, (loss_curves_png(one + checked, "x"), loss_curves_png(more, "y"))
    )
    assert wide > width
    assert high > height


def test_a_validation_alone_can_be_drawn():
    assert size_of(loss_curves_png([entry(1, 0.5, held_out=True)], "x"))
