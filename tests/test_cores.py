"""Work that is spread over processor cores."""

import pytest

from calibration import cores


def test_each_keeps_the_order_and_what_goes_wrong():
    assert cores.each(lambda i: i * i, range(50)) == [i * i for i in range(50)]
    assert cores.each(abs, []) == []
    with pytest.raises(ZeroDivisionError):
        cores.each(lambda i: 1 / i, [2, 1, 0])
