"""The exercises of the vacuum notebook, from one line to the whole filter.

Each is one equation of the derivation as a NumPy function; N robots or particles at once, no loop over them. Metres,
seconds, radians; headings counter-clockwise from the x axis; `constants` is `course_lib.vacuum.constants.Constants`.

bounce-noise
    bounce_noise(p, v_bar) -> v
        p, v any shape: the inverse of F(v) for f(v) = c v² on [-v_bar, v_bar].
bounce
    bounce(heading, normal, noise) -> heading
        heading (N,) of robots driving into a wall, normal (N,) or a number: the direction of the wall's inward normal
        (0 for x = 0, π/2 for y = 0, π for the wall opposite x = 0, -π/2 for the one opposite y = 0), noise (N,) in
        [-1, 1]. Result (N,), wrapped to [-π, π).
prior
    sample_prior(n, constants, rng) -> states (n, 6)
        Columns x_A, y_A, θ_A, x_B, y_B, θ_B. Headings in [-π, π].
drive
    drive(x, y, heading, distance, constants, rng) -> x, y, heading
        All (N,): straight on and round by round off the walls, until each robot has driven its distance; headings in
        [-π, π]. The arguments stay as they are.
likelihood
    log_likelihood(observation, states, constants) -> log-likelihoods (N,)
        observation (4,), inf where a sensor is silent; states (N, 6); -inf, without a warning, where a reading is
        impossible.
resample
    systematic(weights, rng) -> indices (N,) of integers
        weights (N,), normalised.
roughen
    roughen(states, K, constants, rng) -> states (N, 6)
        Normal jitter of standard deviation K Eᵢ N^(-1/6), Eᵢ the largest minus the smallest value in column i;
        positions are kept in the room, headings wrapped to [-π, π).
estimator
    Estimator(previous, observation, control, constants, rng) -> posterior
        As handed in: Particles(states, log_weights) or an array (N, 6) of equally weighted particles.
"""

EXERCISES = ()
