"""What is known of the members of an ensemble: their states, energies and measurements."""

from __future__ import annotations

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import Chain, ChainParameters
from npend_gym.physics import energy as _energy
from npend_gym.physics.kernels.layout import Member, Rod, Turn
from npend_gym.physics.memory import Memory
from npend_gym.physics.step import Chains


class Members:
    """The members of an `Ensemble`, read: every property is a new array."""

    def __init__(self, memory: Memory) -> None:
        self.n: int = memory.n
        self.size: int = memory.size
        self._memory = memory
        self._ready = True  # no call was interrupted
        self._chains: Chains | None = None  # of the members, for steps

    @property
    def _intact(self) -> Memory:
        """The memory; raise an error if a call was interrupted."""
        if not self._ready:
            raise RuntimeError(
                "a call was interrupted and members may be in different steps: make a new Ensemble"
            )
        return self._memory

    @property
    def time(self) -> FloatArray:
        """Time since the state was set [s], shape (B,)."""
        return self._intact.members[Member.TIME].copy()

    @property
    def work(self) -> FloatArray:
        """Work of torques, damping, dry friction and drag since the state was set [J], shape (B,).

        On a cart it includes the work of the force on the cart and of the damping of its rail:
        there it is not the change of `energy`, which leaves out the motion of the cart.
        """
        return self._intact.members[Member.WORK].copy()

    @property
    def diverged(self) -> BoolArray:
        """Members whose state has left all bounds since `set_state` or `set_chain`, shape (B,)."""
        return self._intact.members[Member.DIVERGED] != 0.0

    @property
    def theta(self) -> FloatArray:
        """Angles [rad], not wrapped, shape (B, n)."""
        return self._intact.read(Rod.THETA)

    @property
    def omega(self) -> FloatArray:
        """Angular velocities [rad/s], shape (B, n)."""
        return self._intact.read(Rod.OMEGA)

    @property
    def cart(self) -> tuple[FloatArray, FloatArray]:
        """Position [m] and velocity [m/s] of the carts, shape (B,) each; zero without a cart."""
        return self._intact.read_base(Rod.THETA), self._intact.read_base(Rod.OMEGA)

    @property
    def pseudo_periods(self) -> FloatArray:
        """Pseudo-period of each bob [s], shape (B, n), definition "bob"; NaN where not complete."""
        memory = self._intact
        rows = [memory.lanes_of(record[:, Turn.PERIOD]) for record in memory.record or ()]
        return memory.gather(rows[0])[:, : self.n].copy()

    @property
    def parameters(self) -> ChainParameters:
        """The parameters of the members' chains, shape (B, n)."""
        return self._intact.parameters

    @property
    def kinetic_energy(self) -> FloatArray:
        """Kinetic energy [J], shape (B,), relative to the pivot: without the motion of a cart."""
        return _energy.kinetic_energy(self.parameters, self.theta, self.omega)

    @property
    def energy(self) -> FloatArray:
        """Energy above hanging at rest [J], shape (B,).

        It is relative to the pivot. On a cart it leaves out the motion of the cart, so that its
        change is not `work`.
        """
        return _energy.total_energy(self.parameters, self.theta, self.omega)

    @property
    def positions(self) -> FloatArray:
        """Positions of the bobs [m], shape (B, n, 2)."""
        return _energy.positions(self.parameters, self.theta)

    @property
    def centre_of_mass(self) -> FloatArray:
        """Position of the centre of mass [m], shape (B, 2)."""
        return _energy.centre_of_mass(self.parameters, self.theta)

    @property
    def tip(self) -> FloatArray:
        """Position of the last bob [m], shape (B, 2)."""
        return self.positions[:, -1]

    def chain(self, member: int) -> Chain:
        """Return the chain of a member, with its cart, whose mass may differ in its last bit."""
        return self._intact.chain(member)

    @property
    def _steps(self) -> Chains:
        """The chains of the members, for steps."""
        if self._chains is None:
            memory = self._intact
            terms = len(memory.arrays[2] or ())
            self._chains = Chains(memory.parameters, terms, memory.bases)
        return self._chains
